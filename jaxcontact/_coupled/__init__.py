"""Contacts that last together: one motion from event to event, for any field of them."""
