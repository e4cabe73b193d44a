"""Expansion: loops, conditions, routines, frames and included files become rows.

`program_builder` turns rows into a Program, `name_usage` finds the loops that must run iteration by iteration,
`expander` runs it. Where no iteration of a loop depends on another, all run at once, one lane each.
"""
