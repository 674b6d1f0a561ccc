"""Sound of a bouncing ball: reading files, and timing impacts."""
