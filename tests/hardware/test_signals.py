"""Signals as requests."""

from __future__ import annotations

import signal
from typing import cast

import pytest
from support.controller import needs_controller

from gusjob.controllers.control import Control, PauseKind, StopKind
from gusjob.hardware.signals import stop_on_signals

pytestmark = needs_controller


of_posix = pytest.mark.skipif(not hasattr(signal, "SIGTSTP"), reason="signals of POSIX")


@of_posix
def test_signals_are_requests() -> None:
    handled = (signal.SIGINT, signal.SIGTERM, signal.SIGTSTP, signal.SIGCONT)
    before = {number: signal.getsignal(number) for number in handled}
    for numbers, stop, pause in (
        ([signal.SIGINT], 1, False), ([signal.SIGINT, signal.SIGINT], 2, False), ([signal.SIGTERM], 2, False),
        ([signal.SIGHUP], 2, False), ([signal.SIGTSTP], 0, True), ([signal.SIGTSTP, signal.SIGTSTP], 0, False),
        ([signal.SIGTSTP, signal.SIGTERM, signal.SIGCONT], 2, False),
    ):  # fmt: skip
        control = Control()
        with stop_on_signals(control):
            for number in numbers:
                signal.raise_signal(number)
        assert (control.stop, bool(control.pause), control.requested) == (stop, pause, bool(stop or pause)), numbers
    assert before == {number: signal.getsignal(number) for number in before}


@of_posix
@pytest.mark.parametrize(
    ("requests", "pause"),
    [
        ("CONT", PauseKind.NONE),
        ("TSTP", PauseKind.SUSPENDED),
        ("TSTP CONT", PauseKind.NONE),
        ("TSTP TSTP", PauseKind.NONE),
        ("TSTP key", PauseKind.NONE),
        ("TSTP CONT CONT", PauseKind.NONE),
        ("TSTP CONT TSTP", PauseKind.SUSPENDED),
        ("TSTP TSTP CONT", PauseKind.NONE),
        ("key CONT", PauseKind.USER),
        ("key CONT CONT key", PauseKind.NONE),
        ("key TSTP", PauseKind.NONE),
        ("key TSTP CONT", PauseKind.NONE),
        ("key TSTP key CONT", PauseKind.USER),
        ("TSTP key key CONT", PauseKind.USER),
        ("TSTP CONT key CONT", PauseKind.USER),
    ],
)
def test_sigcont_ends_only_a_pause_that_sigtstp_made(requests: str, pause: PauseKind) -> None:
    """A laser that comes on by itself is dangerous: only the user ends a pause that a key began."""
    control = Control()
    with stop_on_signals(control):
        for request in requests.split():
            if request == "key":
                control.toggle_pause()
            else:
                signal.raise_signal(getattr(signal, f"SIG{request}"))
    assert (control.pause, control.requested) == (pause, bool(pause))


@of_posix
def test_sigcont_when_not_paused_is_no_request() -> None:
    control = Control()
    with stop_on_signals(control):
        signal.raise_signal(signal.SIGCONT)
    assert control == Control()


def test_a_stop_in_the_middle_of_another_request_is_kept() -> None:
    """A handler may run while the same thread handles a key."""
    control = Control()

    class Interrupting:
        """A value during whose reading a signal arrives."""

        def __bool__(self) -> bool:
            if not control.stop:
                control.request_stop("SIGTERM", abrupt=True)
            return False

    control.pause = cast(PauseKind, Interrupting())
    control._notify()
    assert (control.stop, control.requested) == (StopKind.ABRUPT, True)
