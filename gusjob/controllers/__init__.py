"""Controllers: one package for each, with the interface that protocol.py defines."""
