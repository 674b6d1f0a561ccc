"""One isolated impact of two bodies."""
