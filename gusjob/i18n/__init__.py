"""The user's language: phrases and their catalogue."""
