"""Tracks of a bouncing ball from video: finding impacts, and timing them between frames."""
