"""What is computed a block of rows at a time, or without copies, is what the whole columns give."""

from __future__ import annotations

import numpy as np
import pytest

from gusjob.frontend.source import Source
from gusjob.kinematics import arrays


@pytest.mark.parametrize("seed", range(5))
def test_repeated_values(seed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arrays, "BLOCK_ROWS", 7)
    rng = np.random.default_rng(seed)
    for _ in range(100):
        values = rng.integers(0, rng.integers(1, 60), rng.integers(0, 40)).astype(np.uint64)
        assert arrays.repeated(values).tolist() == [i for i, v in enumerate(values) if (values == v).sum() > 1]


@pytest.mark.parametrize("seed", range(5))
def test_lines_of_a_text_of_several_blocks(seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = ["\n", "\r\n", "ab", "é", "x" * 20_000, "y" * 16_384]
    source = Source(name="x", data="".join(rng.choice(parts, 60).tolist()).encode())
    lines = [""] + [line.decode().rstrip("\r") for line in source.data.split(b"\n")] + [""]
    assert [source.line(number) for number in range(len(lines))] == lines
