"""Intervals, bootstrap, and whether the model describes the data."""
