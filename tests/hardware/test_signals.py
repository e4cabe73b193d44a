"""Signals as requests."""

from __future__ import annotations

import signal

import pytest
from support.controller import needs_controller

from gusjob.controllers.control import Control
from gusjob.hardware.signals import stop_on_signals

pytestmark = needs_controller


@pytest.mark.skipif(not hasattr(signal, "SIGTSTP"), reason="signals of POSIX")
def test_signals_are_requests() -> None:
    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGTSTP)}
    for numbers, stop, pause in (
        ([signal.SIGINT], 1, False), ([signal.SIGINT, signal.SIGINT], 2, False), ([signal.SIGTERM], 2, False),
        ([signal.SIGHUP], 2, False), ([signal.SIGTSTP], 0, True), ([signal.SIGTSTP, signal.SIGTSTP], 0, False),
    ):  # fmt: skip
        control = Control()
        with stop_on_signals(control):
            for number in numbers:
                signal.raise_signal(number)
        assert (control.stop, control.pause, control.requested) == (stop, pause, bool(stop or pause)), numbers
    assert before == {number: signal.getsignal(number) for number in before}
