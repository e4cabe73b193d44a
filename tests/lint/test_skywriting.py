"""SKYWRITE: its numbers, and what it can't be combined with."""

from __future__ import annotations

import pytest
from support.skywriting import HEAD_MM, diagnostics_of
from support.tools import diagnostics_in


def test_laser_off_now_at_rest_ends_a_mark() -> None:
    text = "LASER MODE DUTY CARRIER 10\nLASER POWER 50\nVEL 100\nACC 1000\nLASER ON NOW\nLINE X 5\nLASER OFF NOW\n"
    assert "GJ801" not in {code for _, code in diagnostics_in(text + "SKYWRITE MODE 2 TIMELAG 250us\nLINE X 8\n")}


@pytest.mark.parametrize("other", [0, 1])
def test_messages_name_the_smallest_value_that_is_enough(other: int) -> None:
    line, rule = (
        ("SKYWRITE MODE 2 TIMELAG 100us SHIFT -114.5us NPREV 11 NPOST 10\n", "GJ803"),
        ("LASER FOLLOW MIN 5 MAX 45 AT 500mm/s\nSKYWRITE MODE 2 TIMELAG 114.5us NPREV 11 NPOST 10\n", "GJ807"),
    )[other]
    found = [f for f in diagnostics_of(HEAD_MM + line + "LINE X 1\n") if f.rule.code == rule]
    assert [f.fields["least"] for f in found] == [12]
