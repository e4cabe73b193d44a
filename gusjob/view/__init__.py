"""Views of a trace: the path as strokes, pictures and the report page."""
