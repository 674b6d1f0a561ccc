"""The steps of a coupled solve, from event to event."""
