"""Where a run begins."""

from __future__ import annotations

from support.controller import needs_controller
from support.hardware import EVERYTHING
from support.tools import stream_of

from gusjob.hardware.begin import fingerprint

pytestmark = needs_controller


def test_two_streams_that_differ_in_any_call_have_two_fingerprints() -> None:
    texts = (EVERYTHING, EVERYTHING.replace("GAP 20us", "GAP 21us"), EVERYTHING.replace("ARC CW X 8", "ARC CW X 7"))
    assert len({fingerprint(stream_of(text)) for text in texts}) == 3
    assert fingerprint(stream_of(EVERYTHING)) == fingerprint(stream_of(EVERYTHING))
