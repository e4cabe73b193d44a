"""What a stream needs of a controller."""

from __future__ import annotations

from support.controller import needs_controller
from support.hardware import (
    EVERYTHING,
    SYSTEM_2,
    listed,
    zigzag,
)
from support.tools import stream_of

from gusjob.controllers.gus.driver.requirements import check_single_fifo, outputs_of
from gusjob.frontend import check_text, read_listing

pytestmark = needs_controller


def test_calls_of_two_queues_are_refused() -> None:
    text = "GT_LnXY(1,10,0,50,2,0,0)\nGT_LnXY(2,10,0,50,2,0,0)\n"
    source, _ = check_text(text.encode(), "two.gts")
    assert source is not None
    (diagnostic,) = check_single_fifo(read_listing(source)[0])
    assert (diagnostic.rule.code, diagnostic.span.line) == ("GJ917", 2)
    assert check_single_fifo(stream_of(EVERYTHING)) == []


def test_a_channel_that_is_only_switched_at_once_is_turned_off_too() -> None:
    head = SYSTEM_2.replace("GT_BufLaserOn(2,1,0)\n", "").replace("GT_BufLaserPrfCmd(2,40,1,0)\n", "")
    stream = listed(head + zigzag(2) + "GT_SetHSIOOpt(1,1)\nGT_CrdStart(2,2)\n")
    assert outputs_of(stream).channels == (0, 1)
