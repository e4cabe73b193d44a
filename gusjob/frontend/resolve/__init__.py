"""Statements to a Job: modal words, units, absolute positions."""
