"""A trace as pictures and pages."""
