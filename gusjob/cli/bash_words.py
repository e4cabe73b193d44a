"""Completion for bash, which makes three words of --format=json."""

from __future__ import annotations

from itertools import pairwise

from click.shell_completion import BashComplete, add_completion_class


@add_completion_class
class BashWords(BashComplete):
    """click's completion for bash, for --option=value, too."""

    def get_completion_args(self) -> tuple[list[str], str]:
        """Return the complete words and the one to complete, without the = behind an option."""
        words, incomplete = super().get_completion_args()
        own = [word for before, word in pairwise(["", *words]) if not (word == "=" and before.startswith("--"))]
        return own, incomplete
