"""Measured columns and pairs: their checks, noise and outliers."""
