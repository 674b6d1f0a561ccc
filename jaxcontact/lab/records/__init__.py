"""Fits of the force of an impact over time, with instrument errors."""
