"""Calibration of a recording: the fits, their summary, its words and its file."""
