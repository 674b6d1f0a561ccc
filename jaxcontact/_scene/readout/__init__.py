"""Results read from the log of a run: states, impacts, work, and files."""
