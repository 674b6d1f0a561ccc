"""Oblique impacts, and what a user would write or run for them instead."""
