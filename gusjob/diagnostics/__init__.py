"""Reported problems: their model, the rules, suppression, selection, formats and fixes."""
