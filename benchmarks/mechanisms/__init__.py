"""Mechanisms and what a user would write for them instead."""
