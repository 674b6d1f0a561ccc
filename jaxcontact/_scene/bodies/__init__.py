"""Bodies of a scene, their interactions, and their prescribed motions."""
