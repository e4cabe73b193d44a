"""Text of calls to a stream."""
