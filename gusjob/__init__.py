"""Compiler, linter and runner for laser jobs on Googol GUS galvo controllers."""

__version__ = "0.1.0"
