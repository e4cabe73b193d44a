"""How a run ended, and what is known about laser and motion then."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path

from msgspec import Struct

from gusjob.controllers.gus.driver.session import Session
from gusjob.controllers.journal.writer import Journal
from gusjob.diagnostics import rules
from gusjob.diagnostics.model import Diagnostic
from gusjob.hardware.request import Refusal, RunRequest
from gusjob.hardware.supervisor import SessionOutcome

_UNSAFE = (rules.LASER_STATE_UNKNOWN, rules.MOTION_STATE_UNKNOWN, rules.WRONG_ABI)
"""Rules of faults after which the laser may be on or the axes may move."""

_OF_LIBRARY = (rules.NO_LIBRARY, rules.NO_SYMBOLS, rules.WRONG_ABI)


class Ending(StrEnum):
    """How a run ended."""

    UNCONFIRMED = "unconfirmed"
    """Nothing was done: the request is not confirmed."""
    REFUSED = "refused"
    """Nothing was done: the request can't be run; `refusal` says why."""
    BUSY = "busy"
    """Nothing was done: another run uses the controller or continues the journal; `diagnostics` says which."""
    INVALID = "invalid"
    """Nothing was done: the job or the library has errors; `diagnostics` has them."""
    DECLINED = "declined"
    """The plan was not confirmed."""
    NOTHING_LEFT = "nothing-left"
    """The run that was to be continued had been done to its end."""
    FAILED = "failed"
    """The run was stopped or failed; `diagnostics` says why."""
    DONE = "done"


class MachineState(StrEnum):
    """What is known about laser and motion after a run."""

    OFF = "off"
    """Calls confirmed that every laser is off and nothing moves."""
    UNTOUCHED = "untouched"
    """No call was made, but perhaps one off call whose effect is not confirmed."""
    UNKNOWN = "unknown"
    """The laser may be on, or the axes may move."""


class RunOutcome(Struct, frozen=True, kw_only=True):
    """How a run ended.

    `diagnostics`: at the job's spans; `location`: file:line that was reached by a run that failed, '' if it did not
    begin; `elapsed_s`: since the journal was opened; `state`: of laser and motion; `off_tried`: what an off call did
    that was made without a confirmed library; `is_journal_needed`: the journal has the position of a run that was
    declined.
    """

    ending: Ending
    refusal: Refusal | None = None
    diagnostics: tuple[Diagnostic, ...] = ()
    journal: Path | None = None
    location: str = ""
    elapsed_s: float = 0.0
    state: MachineState = MachineState.UNTOUCHED
    off_tried: str = ""
    is_journal_needed: bool = False

    @classmethod
    def refused(cls, refusal: Refusal, journal: Path | None = None) -> RunOutcome:
        """Make the outcome of a request that can't be run."""
        return cls(ending=Ending.REFUSED, refusal=refusal, journal=journal)

    @property
    def is_library_unusable(self) -> bool:
        """Whether nothing was done because the library can't be loaded, lacks calls, or has another ABI."""
        return self.ending is Ending.INVALID and any(found.rule in _OF_LIBRARY for found in self.diagnostics)

    @property
    def is_safe(self) -> bool:
        """Whether calls confirmed that every laser is off and the motion stopped, or no call was made."""
        reached = self.ending in (Ending.FAILED, Ending.DONE)
        return self.state is MachineState.OFF if reached else True


def outcome_of_session(
    request: RunRequest, outcome: SessionOutcome, journal: Journal, session: Session | None
) -> RunOutcome:
    """Make the outcome of a run from that of its session. `session`: None if it only searched for the position."""
    return RunOutcome(
        ending=Ending.FAILED if outcome.faults else Ending.DONE,
        diagnostics=request.located([*outcome.faults, *(session.warnings if session else ())]),
        state=_state(outcome),
        off_tried=outcome.off_tried,
        journal=journal.path,
        location=request.location(session.line) if session else "",
        elapsed_s=journal.now_s(),
    )


def _state(outcome: SessionOutcome) -> MachineState:
    """Return what calls confirmed about laser and motion in a session."""
    if any(fault.rule in _UNSAFE for fault in outcome.faults):
        return MachineState.UNKNOWN
    if outcome.is_off:
        return MachineState.OFF
    return MachineState.UNTOUCHED if outcome.is_untouched else MachineState.UNKNOWN
