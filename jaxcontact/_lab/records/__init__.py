"""Fits of the force of an impact over time, with the errors of the instrument."""
