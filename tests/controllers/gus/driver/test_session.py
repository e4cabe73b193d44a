"""A session: the state that a run begins in, interlock, end position, axes."""

from __future__ import annotations

import numpy as np
import pytest
from support.controller import Fault, Row, needs_controller
from support.hardware import (
    END_2,
    LONG_WITH_DWELL,
    MARK_FIRST,
    SYSTEM_2,
    Bench,
    fresh,
    is_safe,
    listed,
    made_calls,
    zigzag,
)
from support.tools import MARK, stream_of

from gusjob.config.machine import Interlock, Machine
from gusjob.controllers.control import Control
from gusjob.controllers.gus.driver.requirements import outputs_of
from gusjob.controllers.gus.path_position import PathPosition, PositionRange
from gusjob.i18n.phrases import localized

pytestmark = needs_controller


ENERGY = [Row.EMISSION0_MS, Row.EMISSION1_MS, Row.POWER0_MS, Row.POWER1_MS]


def test_a_laser_that_another_program_left_on_is_switched_off(gus: Bench) -> None:
    call = gus.controller.library
    assert [call.GT_Open(0, 1), call.GT_SetHSIOOpt(1, 1)] == [0, 0]
    assert gus.controller.state().emitting[1] or gus.controller.state().switched_on[1]
    assert gus.run(stream_of(MARK_FIRST), gus.machine(Machine())).faults == []
    edges = gus.controller.edges()
    assert not any(gus.controller.state().switched_on)
    assert gus.controller.rows()[:, Row.EMISSION1_MS].sum() == 0, edges


def test_settings_that_another_job_left_do_not_change_this_one(gus: Bench) -> None:
    machine, plain = gus.machine(Machine()), stream_of(MARK_FIRST.replace("ON", "ON", 1))
    assert gus.run(plain, machine).faults == []
    wanted = gus.controller.rows()[:, ENERGY]
    other = MARK + "LASER DISTANCE REF X 0 Y 0 RATIO X 5 Y 5 MIN 0 MAX 100\nLASER DELAY ON 300us OFF 500us\n"
    other += "LASER FPK WIDTH 10us GAP 200us OFFDELAY 100us\nLASER POWER 9\nLASER ON\nLINE X 1\nLASER OFF\nJUMP X 0\n"
    assert gus.run(stream_of(other), machine).faults == []
    done = len(gus.controller.rows())
    assert gus.run(plain, machine).faults == []
    assert gus.controller.rows()[done:, ENERGY] == pytest.approx(wanted)


def test_a_job_that_begins_with_a_mark_begins_at_its_start(gus: Bench) -> None:
    stream, machine = stream_of(MARK_FIRST), gus.machine(Machine())
    assert gus.run(stream, machine).faults == []
    first = gus.controller.rows()
    assert gus.run(stream, machine).faults == []
    way, *again = gus.controller.rows()[len(first) :]
    assert way[ENERGY].sum() == 0
    assert (way[Row.X1], way[Row.Y1]) == (0, 0)
    moved = [Row.X0, Row.Y0, Row.X1, Row.Y1, *ENERGY]
    assert np.array(again)[:, moved] == pytest.approx(first[:, moved])


def test_the_interlock_is_read_right_before_the_start(gus: Bench) -> None:
    gus.controller.option("di", 1)
    gus.controller.fault(Fault.DI, "GT_CrdClear", 1, 1, 0)
    ran = gus.run(stream_of(MARK_FIRST), gus.machine(Machine(), interlock=Interlock(input=0)))
    assert ran.codes == ["GJ910"]
    assert "GT_CrdStart" not in gus.controller.names()


@pytest.mark.parametrize("when", ["before", "while"])
def test_the_interlock(gus: Bench, when: str) -> None:
    machine = gus.machine(Machine(), interlock=Interlock(di_type=4, input=2, value=1))
    gus.controller.option("di", 0 if when == "before" else 0b111)
    if when == "while":
        gus.controller.fault(Fault.DI, "GT_CrdStatus", 8, 1, 0b011)
    ran = gus.run(stream_of(LONG_WITH_DWELL), machine)
    assert ran.codes == ["GJ910"]
    assert "input 2" in ran.faults[0].message
    assert is_safe(gus)
    assert ("GT_LnXY" in gus.controller.names()) == (when == "while")


def test_the_axes_are_those_of_the_profile(gus: Bench) -> None:
    stream = listed(SYSTEM_2.replace("{1,2,0,0,", "{0,0,1,2,") + zigzag(2) + END_2)
    outputs = outputs_of(stream)
    assert (outputs.axes, outputs.crds, outputs.channels) == ((3, 4), (2,), (0,))


def test_the_configuration_is_loaded_before_the_axes_are_on(gus: Bench) -> None:
    machine = gus.machine(Machine(), configuration="field.cfg", axes_off_after=True)
    assert gus.run(stream_of(MARK + "LINE X 1\n"), machine).faults == []
    calls = made_calls(gus)
    assert [c for c in calls if c.startswith(("GT_LoadConfig", "GT_Axis", "GT_Close", "GT_SetCrdPrm"))][:3] == [
        next(c for c in calls if c.startswith("GT_LoadConfig") and "field.cfg" in c), "GT_AxisOn(1)", "GT_AxisOn(2)",
    ]  # fmt: skip
    assert calls[-3:] == ["GT_AxisOff(1)", "GT_AxisOff(2)", "GT_Close()"]


def test_opening_may_take_longer_than_other_calls(gus: Bench) -> None:
    machine = gus.machine(Machine(), call_timeout_s=0.05)
    gus.controller.fault(Fault.HANG, "GT_Open", 1, 1, 0.15)
    assert gus.run(stream_of(MARK + "LINE X 1\n"), machine).faults == []
    fresh(gus)
    gus.controller.fault(Fault.HANG, "GT_ClrSts", 1, 1, 0.15)
    assert "GJ905" in gus.run(stream_of(MARK + "LINE X 1\n"), machine).codes


def test_axes_are_left_as_configured(gus: Bench) -> None:
    for off in (False, True):
        fresh(gus)
        assert gus.run(stream_of(MARK + "LINE X 1\n"), gus.machine(Machine(), axes_off_after=off)).faults == []
        assert gus.controller.state().axes == (0 if off else 0b11)


def test_a_wrong_end_position_is_reported(gus: Bench) -> None:
    gus.controller.option("pos_error", 50)
    ran = gus.run(stream_of(MARK + "LINE X 5\n"), gus.machine(Machine()))
    assert ran.codes == ["GJ909"]
    assert "X 5050" in ran.faults[0].message


def test_a_stage_with_a_wrong_end_is_run_again_as_a_whole(gus: Bench) -> None:
    """Calls may have been lost anywhere in it, so that nobody knows what of it was marked."""
    text = (
        MARK
        + "LASER POWER 40\nLASER ON\nLINE X 5\nLASER OFF\nLASER DELAY ON 20us OFF 30us\nDWELL 900\n"
        + "LASER ON\nLINE X 9\nLASER OFF\n"
    )
    stream, machine = stream_of(text), gus.machine(Machine())
    second = [call.at for call in stream.calls if call.name == "GT_CrdClear"][1]

    def tick(control: Control) -> None:
        if control.status.row >= second:
            gus.controller.option("pos_error", 50)

    fresh(gus, poll_us=3_000)
    ran = gus.run(stream, machine, tick=tick)
    assert ran.codes == ["GJ909"]
    end = PathPosition(row=len(stream.buffered))
    assert ran.session.broken == PositionRange(earliest=PathPosition(row=second), latest=end)
    gus.controller.option("pos_error", 0)
    again, position = gus.resumed(stream, machine, ran.journal)
    assert again.faults == []
    assert position == PathPosition(row=second)


def test_the_end_is_wrong_in_y_alone(gus: Bench) -> None:
    gus.controller.fault(Fault.RETURN, "GT_GetCrdPos", 1, -1, 0)  # It always finds X 0 Y 0.
    ran = gus.run(stream_of(MARK + "LINE X 0 Y 5\n"), gus.machine(Machine()))
    assert ran.codes == ["GJ909"]


@pytest.mark.parametrize(("error", "codes"), [(2, []), (3, ["GJ909"])])
def test_the_tolerance_of_the_end(gus: Bench, error: int, codes: list[str]) -> None:
    gus.controller.option("pos_error", error)
    assert gus.run(stream_of(MARK + "LINE X 5\n"), gus.machine(Machine())).codes == codes


def test_a_library_that_hangs_before_its_abi_is_confirmed_only_gets_the_off_call_of_every_abi(gus: Bench) -> None:
    """Another one it would take for something else."""
    machine = gus.machine(Machine(), call_timeout_s=0.03)
    gus.controller.fault(Fault.HANG, "GT_ClrSts", 1)
    gus.controller.fault(Fault.RETURN, "GT_ClrSts", 2, -1, -7)
    ran = gus.run(stream_of(MARK_FIRST), machine)
    assert ran.codes == ["GJ905"]
    assert gus.controller.names()[:1] == ["GT_Open"]
    laser = [call for call in made_calls(gus) if not call.startswith(("GT_Open", "GT_ClrSts"))]
    assert laser == ["GT_SetHSIOOpt(0,0)"]
    assert "GT_SetHSIOOpt(0,0) returned 0" in localized(ran.session.harmless_off)
    gus.controller.release()
