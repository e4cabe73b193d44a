"""Text to columns: each line shape is learned once, all its numbers are read at once."""
