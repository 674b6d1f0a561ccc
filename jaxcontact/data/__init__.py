"""Small real measurements, each with its source in SOURCES.md beside it, and example scenes."""
