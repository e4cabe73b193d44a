"""Text to columns: each line shape is learned once, the numbers of all its lines are read at once.

A job of a million lines has a handful of line shapes. `shapes` finds the shape of each line and remembers what a shape
means, `scanner` reads the numbers, `rows` holds the result as columns.
"""
