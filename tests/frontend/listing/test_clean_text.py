"""Which texts of calls need cleaning: comments in lines, strings, octal numbers."""

from __future__ import annotations

import random
import re

import pytest

from gusjob.frontend.listing import clean_text
from gusjob.frontend.listing.clean_text import OCTAL_MARK

OCTAL = re.compile(r"(?<![0-9A-Za-z_.])(?<![eE][-+])0[0-9]")
"""A number that begins with a zero before another digit."""


def is_marked(text: str) -> bool:
    cleaned = clean_text.clean_text(text.encode()).data.decode()
    return OCTAL_MARK in cleaned or cleaned != text


@pytest.mark.parametrize("size", [1, 3, 1 << 20])
def test_numbers_with_a_leading_zero_are_found(size: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clean_text, "_PROBED_BYTES", size)
    rng = random.Random(size)
    for _ in range(3000):
        text = "".join(rng.choice("0017.eE+- ,(x_\n") for _ in range(rng.randrange(12)))
        assert clean_text._has_leading_zero(text.encode()) == (OCTAL.search(text) is not None), text


def test_octal_numbers_are_marked_and_others_are_not() -> None:
    assert is_marked("GT_LnXY(1,017,0,50,2,0,0)")
    assert not is_marked("GT_LnXY(1,100,-0,5.05,1e-05,0.5,0);x07 a.05")
