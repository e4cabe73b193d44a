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


def test_numbers_with_a_leading_zero_are_found() -> None:
    rng = random.Random(1)
    for _ in range(9000):
        text = "".join(rng.choice("0017.eE+- ,(x_\n") for _ in range(rng.randrange(12)))
        assert clean_text._has_leading_zero(text.encode()) == (OCTAL.search(text) is not None), text


def test_parts_of_a_text_make_no_difference(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = random.Random(5)
    pieces = [
        "/*",
        "*/",
        "//",
        '"',
        "'",
        "\\",
        "\\\n",
        "\n",
        "\n",
        "\r\n",
        "01",
        "0",
        "7",
        "e-",
        "#",
        " ",
        "x",
        "中",
        ";",
    ]
    for _ in range(3000):
        data = "".join(rng.choice(pieces) for _ in range(rng.randrange(25))).encode()
        monkeypatch.setattr(clean_text, "_PART_BYTES", 1 << 20)
        whole = clean_text.clean_text(data)
        monkeypatch.setattr(clean_text, "_PART_BYTES", rng.randrange(1, 9))
        parts = clean_text.clean_text(data)
        # Only where nothing else needs cleaning, octal numbers within comments are left.
        assert without_comments(parts.data) == without_comments(whole.data), data
        assert parts.problems == whole.problems, data


def without_comments(data: bytes) -> bytes:
    return re.sub(rb"//[^\n]*", b"//", data)


def test_only_parts_with_something_to_clean_are_written_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clean_text, "_PART_BYTES", 20)
    plain = b'GT_CrdClear(1,0); // 07.10. it\'s "plain" /* here\n' * 3
    assert clean_text.clean_text(plain).data is plain
    cleaned = clean_text.clean_text(plain + b"GT_CrdClear(1 /* 01\n*/,0);\n" + plain).data
    assert cleaned == plain + b"GT_CrdClear(1      \n  ,0);\n" + plain


def test_octal_numbers_are_marked_and_others_are_not() -> None:
    assert is_marked("GT_LnXY(1,017,0,50,2,0,0)")
    assert not is_marked("GT_LnXY(1,100,-0,5.05,1e-05,0.5,0);x07 a.05")
