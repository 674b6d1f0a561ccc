"""Tables from files of any usual kind: text, headings, units and rows."""
