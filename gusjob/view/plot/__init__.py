"""Trace to what is drawn: the path in strokes, and pictures of it."""
