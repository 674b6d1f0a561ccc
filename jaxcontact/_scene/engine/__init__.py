"""The search of a run: which event is next, isolated impacts and coupled solves, and the log."""
