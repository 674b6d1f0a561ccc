"""Readout of a finished run of a mechanism: contacts, states, files."""
