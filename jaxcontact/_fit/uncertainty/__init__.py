"""Intervals, bootstrap, and tests whether the model describes the data."""
