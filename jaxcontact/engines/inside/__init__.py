"""Contacts of a law within the time steps of another engine, without knowing which engine."""
