"""Figures of recordings and their calibration."""
