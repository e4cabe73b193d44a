"""Canonical layout of a job's text: what `gusjob fmt` writes."""

from gusjob.frontend.format.formatter import format_source, format_text

__all__ = ["format_source", "format_text"]
