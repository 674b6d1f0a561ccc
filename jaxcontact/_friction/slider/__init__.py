"""One spring and slider, phase by phase."""
