"""What all pictures share: axes, labels, style, and paths of bodies."""
