"""Column layouts of recordings, one class each: reading and pairing of rows."""
