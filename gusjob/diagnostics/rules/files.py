"""GJ0: files that can't be read, are no text, are too large or are empty."""

from __future__ import annotations

from gusjob.diagnostics.rules.registry import ERROR, NOTE, WARNING, rule, variant

UNREADABLE = rule(
    "GJ001",
    ERROR,
    title="file can't be read",
    text="can't read this file: {reason}",
    why="gusjob neither checks nor runs what it can't read.",
)
NOT_TEXT = rule(
    "GJ002",
    ERROR,
    title="file is not text",
    text="this is not UTF-8 text: {reason}",
    why="An invalid byte may hide any character, also a digit or a sign.",
)
TOO_LARGE = rule(
    "GJ003",
    ERROR,
    title="file is too large",
    text="this file has {size} MB; the limit is {limit} MB",
    why="A larger file and the data made from it do not fit into memory. Split the job.",
)
EMPTY = rule(
    "GJ004",
    WARNING,
    title="file without content",
    text="this file has no {what}",
    why="A job without statements is usually the wrong file.",
    bad="; LINE X 10\n",
    good="WAIT\n",
)
NOT_LISTED = rule(
    "GJ005",
    NOTE,
    title="more diagnostics of the same rule",
    text="{count} more of {code} are not listed; the limit for each rule is {shown}",
    why="The first diagnostics of a rule are usually enough to find the cause.",
)
LINE_TOO_LONG = rule(
    "GJ006",
    ERROR,
    title="line is too long",
    text="this line has {size} characters; the limit is {limit}",
    why="A line of this length is usually not job text, or its line ends are missing.",
)
HIDDEN_TEXT = rule(
    "GJ007",
    ERROR,
    title="character that hides text",
    text="the character {character} ends a line in some programs only: write a line end or a blank instead",
    why="What an editor shows and what gusjob reads would differ: a statement may look like part of a comment. This "
    "holds in comments and strings, too.",
    bad="WAIT ; cool down\u2028DWELL 5\n",
    good="WAIT ; cool down\nDWELL 5\n",
)
HIDDEN_BY_CONTROL = variant(HIDDEN_TEXT, text="the control character {character} is not allowed: remove it")
HIDDEN_BY_DIRECTION = variant(
    HIDDEN_TEXT, text="the character {character} changes the order in which text is shown: remove it"
)
