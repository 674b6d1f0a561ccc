"""Tables from files of any usual kind: their text, headings, units and rows."""
