"""The derivative of a run, from the rows of its log."""
