"""Layouts of recordings, one class for each: how rows are read and paired."""
