"""The changes of formatting as a unified diff.

Lines correspond one to one, except for blank lines that were removed and lines that are added at the end. So nothing
has to be searched for, and the diff of a million lines takes no longer than reading them.
"""

from __future__ import annotations

from collections.abc import Iterator

CONTEXT = 3
_SAME, _OLD, _NEW = b" ", b"-", b"+"
_BLANKS = b" \t\r\n"


def unified_diff(name: str, before: bytes, after: bytes) -> Iterator[bytes]:
    """The parts of the diff; none if the texts are equal."""
    rows = list(_rows(_lines(before), _lines(after)))
    changed = [i for i, (mark, _) in enumerate(rows) if mark != _SAME]
    if changed:
        shown = name.encode("utf-8", "backslashreplace")
        yield b"--- %b\n+++ %b\n" % (shown, shown)
    old = new = passed = 0
    for start, end in _hunks(changed, len(rows)):
        old += sum(mark != _NEW for mark, _ in rows[passed:start])
        new += sum(mark != _OLD for mark, _ in rows[passed:start])
        hunk = rows[start:end]
        olds, news = sum(mark != _NEW for mark, _ in hunk), sum(mark != _OLD for mark, _ in hunk)
        yield b"@@ -%d,%d +%d,%d @@\n" % (old + bool(olds), olds, new + bool(news), news)
        for mark, line in hunk:
            yield mark + line if line.endswith(b"\n") else mark + line + b"\n\\ No newline at end of file\n"
        old, new, passed = old + olds, new + news, end


def _lines(data: bytes) -> list[bytes]:
    """Lines with their ends."""
    *lines, last = data.split(b"\n")
    return [line + b"\n" for line in lines] + ([last] if last else [])


def _rows(before: list[bytes], after: list[bytes]) -> Iterator[tuple[bytes, bytes]]:
    """Every line with its mark; in a sequence of changed lines the old ones come first."""
    olds: list[bytes] = []
    news: list[bytes] = []
    j = 0
    for old in before:
        if not old.strip(_BLANKS) and (j == len(after) or after[j].strip(_BLANKS)):
            olds.append(old)
            continue
        if old != after[j]:
            olds.append(old)
            news.append(after[j])
        else:
            yield from [*((_OLD, line) for line in olds), *((_NEW, line) for line in news), (_SAME, old)]
            olds, news = [], []
        j += 1
    yield from [*((_OLD, line) for line in olds), *((_NEW, line) for line in [*news, *after[j:]])]


def _hunks(changed: list[int], count: int) -> Iterator[tuple[int, int]]:
    """Start and end of each hunk: changes that are near each other, with their context."""
    first = 0
    for i, at in enumerate(changed):
        if i + 1 == len(changed) or changed[i + 1] - at > 2 * CONTEXT + 1:
            yield max(changed[first] - CONTEXT, 0), min(at + CONTEXT + 1, count)
            first = i + 1
