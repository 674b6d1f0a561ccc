"""A scene as arrays."""
