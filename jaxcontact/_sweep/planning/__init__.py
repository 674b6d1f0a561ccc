"""The plan of a sweep: its axes, blocks, and what identifies its values."""
