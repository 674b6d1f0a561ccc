"""Friction laws from measured oblique impacts: a fit of one law, and the choice among several."""
