"""One line to its statement: lark gives the tree, the table of statement forms says which words it takes."""
