"""Measured columns and pairs: checks, noise and outliers."""
