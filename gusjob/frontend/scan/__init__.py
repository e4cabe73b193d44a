"""Text to columns: each line shape is learned once, the numbers of all its lines are read at once.

A job of a million lines has a handful of line shapes. `line_table` finds the shape of each line of a chunk, `shape_ids`
remembers what each shape means, `numerals` reads the numbers, `scanner` puts it together, `rows` holds the result as
columns. `shapes` finds shapes without arrays, for the formatter.
"""
