"""Pictures of the path, drawn with matplotlib."""
