"""One line to one statement: the grammar, the statement forms, expressions."""
