"""Words, units, columns of text, progress and files."""
