"""Many bodies, from event to event."""
