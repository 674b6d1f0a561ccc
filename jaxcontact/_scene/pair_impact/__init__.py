"""An isolated impact of two bodies."""
