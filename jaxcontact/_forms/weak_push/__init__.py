"""The change of a free impact by a weak push."""
