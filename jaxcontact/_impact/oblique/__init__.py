"""Oblique impacts: the tangential motion beside the normal one."""
