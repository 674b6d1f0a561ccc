"""Bodies of a scene, what acts between them, and how they move by themselves."""
