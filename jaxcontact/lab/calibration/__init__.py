"""Calibration of a recording: fits, summary, reports and file."""
