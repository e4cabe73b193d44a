"""How good each mark is."""
