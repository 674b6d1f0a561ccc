"""Contacts of several bodies at once, as one system of equations."""
