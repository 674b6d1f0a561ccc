"""Measured pairs of closing speed and restitution: their noise and their outliers."""
