"""Running loops, routines, conditions, frames and includes."""
