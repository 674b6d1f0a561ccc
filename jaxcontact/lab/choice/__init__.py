"""Kinds of laws by e(v), and the choice among them."""
