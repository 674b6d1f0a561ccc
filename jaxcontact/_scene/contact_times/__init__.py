"""The next time at which two bodies touch."""
