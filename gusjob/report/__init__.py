"""Trace to rows and totals, and those to table, JSON and CSV."""
