"""Numbers for line shapes: each shape is learned once, and the lines of a chunk are looked up together.

A hash of the words of a shape finds it, and the words themselves prove it.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from msgspec import Struct, field

from gusjob.frontend.scan.line_table import MAX_WORDS, LineTable, count_numerals
from gusjob.frontend.scan.numerals import Words
from gusjob.kinematics.arrays import Bools, Indices, Ints

_FACTORS = np.array([pow(0x9E3779B97F4A7C15, k + 1, 1 << 64) for k in range(MAX_WORDS)], dtype=np.uint64)


class ShapeIds(Struct):
    """The numbers of the shapes that are known.

    Attributes:
        hashes: Hash of each short shape, ascending.
        ids: Number of each of them, and how many numerals it has, (2, k).
        words: Words of each of them.
        others: The same numbers of long shapes, and of those whose hash another one has.
    """

    hashes: Words = field(default_factory=lambda: np.zeros(0, dtype=np.uint64))
    ids: Ints = field(default_factory=lambda: np.zeros((2, 0), dtype=np.int64))
    words: Words = field(default_factory=lambda: np.zeros((MAX_WORDS, 0), dtype=np.uint64))
    others: dict[bytes, tuple[int, int]] = field(default_factory=dict)

    def look_up(
        self, table: LineTable, learn: Callable[[bytes], int], unread: Indices, unread_id: int
    ) -> tuple[Ints, Ints]:
        """The number of the shape of each line, and the index of its first numeral; new shapes are learned.

        Args:
            table: The lines.
            learn: Gives the number of a new shape by the code of its first line.
            unread: Lines that are not looked up.
            unread_id: The number of their shapes.
        """
        is_short = table.lengths <= MAX_WORDS * 8
        is_short[unread] = False
        hashes = np.zeros(len(table), dtype=np.uint64)
        for word, factor in zip(table.words, _FACTORS, strict=False):
            hashes += word * factor
        found, is_known = self._known(hashes, table.words)
        if not is_known.all():
            self._learn_first(table, learn, hashes, np.flatnonzero(is_short & ~is_known))
            found, is_known = self._known(hashes, table.words)
        if len(unread) or not is_short.all() or not is_known.all():
            for i in np.flatnonzero(~is_short | ~is_known).tolist():
                found[:, i] = self._other(table, learn, i)
            for i in unread.tolist():
                found[:, i] = unread_id, count_numerals(table.code[i])
        ids, counts = found
        first = np.cumsum(counts)
        first -= counts
        return ids, first

    def _known(self, hashes: Words, words: list[Words]) -> tuple[Ints, Bools]:
        """What is known of each shape, and whether it is."""
        if not len(self.hashes):
            return np.zeros((2, len(hashes)), dtype=np.int64), np.zeros(len(hashes), dtype=np.bool_)
        at = np.searchsorted(self.hashes, hashes)
        np.minimum(at, len(self.hashes) - 1, out=at)
        same = self.hashes[at] == hashes
        for known, word in zip(self.words, words, strict=False):
            same &= known[at] == word
        if len(words) < MAX_WORDS:
            same &= np.asarray(~self.words[len(words) :].any(axis=0))[at]
        return self.ids[:, at], same

    def _learn_first(self, table: LineTable, learn: Callable[[bytes], int], hashes: Words, unknown: Indices) -> None:
        """Learn the shape of the first line with each hash that is new, in line order."""
        new = hashes[unknown]
        order = np.argsort(new, kind="stable")
        is_first = np.ones(len(order), dtype=np.bool_)
        is_first[1:] = new[order[1:]] != new[order[:-1]]
        firsts = np.sort(unknown[order[is_first]])
        firsts = firsts[~np.isin(hashes[firsts], self.hashes)]
        codes = [table.code[i] for i in firsts.tolist()]
        ids = np.array([(learn(code), count_numerals(code)) for code in codes], dtype=np.int64).reshape(-1, 2)
        added = np.zeros((MAX_WORDS, len(firsts)), dtype=np.uint64)
        for i, word in enumerate(table.words):
            added[i] = word[firsts]
        all_hashes = np.concatenate([self.hashes, hashes[firsts]])
        order = np.argsort(all_hashes)
        self.hashes = all_hashes[order]
        self.ids = np.concatenate([self.ids, ids.T], axis=1)[:, order]
        self.words = np.concatenate([self.words, added], axis=1)[:, order]

    def _other(self, table: LineTable, learn: Callable[[bytes], int], line: int) -> tuple[int, int]:
        """What is known of a shape that is looked up alone."""
        shape = table.shape(line)
        if shape not in self.others:
            code = table.code[line]
            self.others[shape] = learn(code), count_numerals(code)
        return self.others[shape]
