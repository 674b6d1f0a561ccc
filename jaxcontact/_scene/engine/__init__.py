"""The event loop of a run: the next event, isolated impacts, coupled solves, and the log."""
