"""Modal state: mode, laser command and power at every row of the path."""

from __future__ import annotations

import numpy as np
from support.tools import job_of

from gusjob.controllers.gus.ranges import PowerMode
from gusjob.ir.modal import modal_state
from gusjob.ir.setup import LaserDelay

HEAD = "LASER MODE DUTY CARRIER 10\nVEL 100\nACC 10000\nLASER POWER 30\n"


def test_the_laser_is_on_from_the_row_behind_on_to_off_itself() -> None:
    job = job_of(HEAD + "JUMP X 1\nLASER ON\nLINE X 2\nLINE X 3\nLASER OFF\nJUMP X 4\n")
    laser = modal_state(job).laser(0)
    # Rows: power, jump, on, line, line, off, jump.
    assert laser.on.tolist() == [False, False, False, True, True, True, False]
    assert laser.on_line[laser.on].tolist() == [6, 6, 6]
    assert not laser.on_at_end
    assert not modal_state(job).laser(1).on.any()


def test_a_second_on_changes_nothing() -> None:
    laser = modal_state(job_of(HEAD + "LASER ON\nLINE X 2\nLASER ON\nLINE X 3\n")).laser(0)
    assert laser.on_at_end
    assert laser.last_on_line == 5
    assert set(laser.on_line[laser.on].tolist()) == {5}


def test_laser_on_now_acts_before_all_rows_of_its_stage() -> None:
    """It is written behind LASER POWER, which is a row of the same stage."""
    modal = modal_state(job_of(HEAD + "LASER ON NOW\nLINE X 2\nLASER OFF NOW\nLINE X 3\n"))
    assert modal.laser(0).on.tolist() == [True, True, False]
    switches = modal.switches(0)
    assert switches.instant.tolist() == [0, 4]
    assert not switches.is_buffered.any()
    assert switches.on_at(np.array([0, 1, 4, 5])).tolist() == [False, True, True, False]


def test_a_mode_is_in_force_up_to_the_next_one_of_its_channel() -> None:
    text = HEAD + "LASER MODE ANALOG CHANNEL 1\nLINE X 2\nLASER MODE DUTY2 CARRIER 20\nLASER POWER 20\nLINE X 3\n"
    modal = modal_state(job_of(text))
    first, second = modal.modes(0)
    assert [(span.mode.mode, span.first, span.last) for span in (first, second)] == [
        (PowerMode.DUTY, 0, 2),
        (PowerMode.DUTY2, 2, 4),
    ]
    assert [(span.mode.mode, span.first, span.last) for span in modal.modes(1)] == [(PowerMode.ANALOG, 0, 4)]


def test_the_mode_of_a_setup_statement_is_the_last_before_it_or_the_first_behind() -> None:
    text = "LASER DELAY ON 1 OFF 2\nLASER MODE ANALOG\nLASER DELAY ON 3 OFF 4\nLASER MODE DUTY CARRIER 10\n"
    modal = modal_state(job_of(text))
    spans = [modal.mode_of(setup) for setup, _ in modal.statements(LaserDelay)]
    assert [span.mode.mode for span in spans if span is not None] == [PowerMode.ANALOG, PowerMode.ANALOG]
