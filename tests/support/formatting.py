"""Parts of a job's text, formatted texts and diffs."""

from __future__ import annotations

import re

from gusjob.frontend.format import format_text


def formatted(text: str) -> str:
    """The formatted text, which must be one that can be parsed."""
    result, diagnostics = format_text(text)
    assert result is not None, [diagnostic.message for diagnostic in diagnostics]
    return result


def comment_of(line: str) -> str:
    """The comment of a line."""
    starts = [i for i in (line.find(";"), line.find("//")) if i >= 0]
    return line[min(starts) :].rstrip(" \t\r") if starts else ""


def comments(text: str) -> list[str]:
    """All comments of a text."""
    return [c for c in map(comment_of, text.split("\n")) if c]


def code(text: str) -> str:
    """A text without its comments."""
    return "\n".join(line[: len(line.rstrip(" \t\r")) - len(comment_of(line))] for line in text.split("\n"))


def numbers(text: str) -> list[str]:
    """All numbers outside of comments."""
    return re.findall(r"(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?", code(text))


def letters(text: str) -> str:
    """All that is neither blank nor =, in upper case."""
    return re.sub(r"[\s=]", "", code(text)).upper()


def patched(before: bytes, diff: bytes) -> bytes:
    """Apply a diff to a text; every line that it names must be there."""
    old, result, at = before.split(b"\n"), list[bytes](), 0
    old = [line + b"\n" for line in old[:-1]] + ([old[-1]] if old[-1] else [])
    rows = diff.replace(b"\n\\ No newline at end of file\n", b"\0").split(b"\n")[2:]
    for row in (r for joined in rows if joined for r in re.findall(rb"[^\0]+\0?", joined)):
        line = row[1:-1] if row.endswith(b"\0") else row[1:] + b"\n"
        head = re.match(rb"@@ -(\d+),(\d+) \+(\d+),(\d+) @@", row)
        if head:
            start = int(head[1]) - (head[2] != b"0")
            result += old[at:start]
            assert len(result) == int(head[3]) - (head[4] != b"0")
            at = start
        elif row[:1] == b"+":
            result.append(line)
        else:
            assert old[at] == line
            result += [line] if row[:1] == b" " else []
            at += 1
    return b"".join([*result, *old[at:]])
