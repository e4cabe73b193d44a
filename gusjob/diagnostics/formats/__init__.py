"""Diagnostics as text, JSON, SARIF and JUnit."""
