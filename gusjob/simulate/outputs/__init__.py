"""Trace to signals over time: the controller's electrical outputs (VCD), and a table of its ticks."""
