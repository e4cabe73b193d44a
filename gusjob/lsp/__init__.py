"""A language server (LSP 3.17): diagnostics, completion, hovers, definitions, symbols, formatting and quick fixes."""
