"""Tuned delays and sky writing against closed forms, and the bytes of a job that is written. Numbers by hand.

1000 pulse/mm: 100 mm/s is 100 pulse/ms, and a lag of 250 us is 25 um of it. A slack of a pulse is 1 um.
"""

from __future__ import annotations

import json
import math
import os
import random
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import pytest
from click.testing import CliRunner, Result
from msgspec.structs import replace
from support.tools import MACHINE, ROOT

from gusjob.cli import cli
from gusjob.config.machine import Machine, ScannerModel, parse_scanner
from gusjob.frontend import check_text
from gusjob.simulate.quality.marks import marks_of
from gusjob.tune import CLOSED_FORM, SEARCH, TuneResult, run_text, search, tune_delays, tune_sky_writing

MODELS = ["delay", "first-order", "second-order"]
FILTERS = MODELS[1:]
DUTY = "LASER MODE DUTY CARRIER 10\n"
YAG = "LASER MODE FREQUENCY WIDTH 2us\n"
SPEEDS = "VEL 100\nACC 10000\nLASER POWER 30\n"
AT_SPEED = "JUMP X 5\nLASER ON\nLINE X 10\nLASER OFF\nJUMP X 15\n"
FROM_REST = "LASER ON\nLINE X 5\nLASER OFF\n"


def lagging(text: str) -> Machine:
    scanner = parse_scanner(text)
    assert not isinstance(scanner, str)
    return replace(MACHINE, scanner=scanner)


def tuned(text: str, scanner: str, channel: int = 0, mode: int | None = None, *, sky: bool = False) -> TuneResult | str:
    source, _ = check_text(text.encode(), "test.job")
    assert source is not None
    machine = lagging(scanner)
    run = run_text(source, machine)
    assert run.trace is not None, [f.message for f in run.diagnostics]
    return tune_sky_writing(run, machine, channel, mode) if sky else tune_delays(run, machine, channel)


def statement(text: str, scanner: str, channel: int = 0, mode: int | None = None, *, sky: bool = False) -> str:
    found = tuned(text, scanner, channel, mode, sky=sky)
    assert isinstance(found, TuneResult), found
    return found.statement


def delays(text: str, scanner: str, channel: int = 0) -> tuple[int, int]:
    words = statement(text, scanner, channel).split()
    assert words[:3] == ["LASER", "DELAY", "ON"]
    return int(words[3].removesuffix("us")), int(words[5].removesuffix("us"))


def worst(found: TuneResult | str, channel: int = 0) -> dict[str, float]:
    assert isinstance(found, TuneResult), found
    (entry,) = (e for e in found.run.marking if e["channel"] == channel)
    return dict(entry["worst"])


# LASER DELAY.


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("lag_us", [50, 550])
def test_at_speed_the_delays_are_the_lag(model: str, lag_us: int) -> None:
    found = tuned(DUTY + SPEEDS + AT_SPEED, f"{model}:{lag_us}us")
    assert isinstance(found, TuneResult)
    assert found.statement == f"LASER DELAY ON {lag_us}us OFF {lag_us}us"
    assert found.how == (CLOSED_FORM if model == "delay" else SEARCH)
    after = worst(found)
    assert (after["on_miss_um"], after["off_miss_um"]) == pytest.approx((0, 0), abs=1e-3)


def test_a_pure_delay_from_rest_to_rest() -> None:
    found = tuned(DUTY + SPEEDS + FROM_REST, "delay:250us")
    assert isinstance(found, TuneResult)
    assert (found.statement, found.how) == ("LASER DELAY ON 250us OFF 250us", CLOSED_FORM)
    assert (worst(found)["on_miss_um"], worst(found)["off_miss_um"]) == (0, 0)


@pytest.mark.parametrize("model", MODELS)
def test_without_lag_there_is_nothing_to_delay(model: str) -> None:
    found = tuned(DUTY + SPEEDS + FROM_REST, f"{model}:0us")
    assert isinstance(found, TuneResult)
    assert (found.statement, found.how) == ("LASER DELAY ON 0us OFF 0us", CLOSED_FORM)


def speeding_up(model: str, lag: float, time: float) -> float:
    """Where the beam is, a time after it began to speed up with 1 pulse/ms2; tau x' + x = t^2/2, or twice tau/2."""
    if time <= 0:
        return 0.0
    if model == "first-order":
        return time**2 / 2 - lag * time + lag**2 * (1 - math.exp(-time / lag))
    half = lag / 2
    return time**2 / 2 - 2 * half * time + 3 * half**2 - (3 * half**2 + half * time) * math.exp(-time / half)


@pytest.mark.parametrize("model", FILTERS)
@pytest.mark.parametrize(
    ("vel", "acc", "lag_us"),
    [(1000, 1000, 250), (500, 300, 120), (2000, 1000, 400), (100, 10, 250), (300, 10, 900)],
)
def test_from_rest_to_rest_as_all_delays_tried(model: str, vel: float, acc: float, lag_us: int) -> None:
    """LINE of 60 mm, long enough to be at speed for a while; `vel` in pulse/ms, `acc` in pulse/ms2."""
    lag, slowing = lag_us / 1000, vel / acc
    early = [abs(acc * speeding_up(model, lag, us / 1000)) for us in range(12 * lag_us + 1)]
    late = []
    for us in range(12 * lag_us + 1):
        since = us / 1000 + slowing
        place = vel * (since - lag) - acc * speeding_up(model, lag, since) + acc * speeding_up(model, lag, us / 1000)
        late.append(abs(vel * slowing / 2 - place))
    ons, offs = (
        [us for us, miss in enumerate(misses) if miss <= least + 1]
        for misses, least in ((early, min(early)), (late, min(late)))
    )
    text = f"{DUTY}VEL {vel}\nACC {acc * 1000}\nLASER POWER 30\nLASER ON\nLINE X 60\nLASER OFF\n"
    on_us, off_us = delays(text, f"{model}:{lag_us}us")
    assert on_us <= off_us
    if ons[-1] <= offs[0]:
        # Not under the light while it stands.
        assert abs(on_us - ons[-1]) <= 1
        assert abs(off_us - offs[0]) <= 1
    else:
        assert on_us == off_us == min(set(ons) & set(offs), key=lambda us: abs(us - lag_us))


def test_on_from_rest_and_off_at_speed_stays_near_at_both() -> None:
    """From rest the light may come late, at speed it may not go late: on comes earlier, off does not go later."""
    text = DUTY + "VEL 500\nACC 2000\nLASER POWER 30\nLASER ON\nLINE X 70\nLASER OFF\nJUMP X 140\n"
    assert acc_free_ms(2.0, 0.1) > 0.6
    found = tuned(text, "first-order:100us")
    assert isinstance(found, TuneResult)
    assert found.statement == "LASER DELAY ON 100us OFF 100us"
    assert worst(found)["on_miss_um"] < 1
    assert worst(found)["off_miss_um"] < 0.01


def acc_free_ms(acc: float, lag: float) -> float:
    """How long a beam of first order stays within a pulse of where it starts, in steps of 10 us."""
    return next(k / 100 for k in range(1000) if acc * speeding_up("first-order", lag, k / 100) > 1)


def test_off_is_never_below_on() -> None:
    """OFFDELAY takes more off than GAP does: light off would have to come before light on."""
    text = YAG + "LASER FPK WIDTH 5 GAP 10 OFFDELAY 90\n" + SPEEDS + AT_SPEED
    assert delays(text, "delay:250us") == (240, 240)
    # Within a pulse, 10 us, of the lag at one end; 70 us late at the other.
    on_us, off_us = delays(text, "first-order:250us")
    assert on_us == off_us == 230


@pytest.mark.parametrize("model", MODELS)
def test_what_the_first_pulse_killer_delays_is_taken_off(model: str) -> None:
    text = YAG + "LASER FPK WIDTH 5 GAP 40 OFFDELAY 30\n" + SPEEDS + AT_SPEED
    assert delays(text, f"{model}:250us") == (210, 220)
    assert delays(text, f"{model}:20us") == (0, 0)


@pytest.mark.parametrize("model", MODELS)
def test_each_channel_has_its_own(model: str) -> None:
    both = AT_SPEED.replace("LASER ON\n", "LASER ON CHANNEL 0\nLASER ON CHANNEL 1\n").replace(
        "LASER OFF\n", "LASER OFF CHANNEL 0\nLASER OFF CHANNEL 1\n"
    )
    text = (
        YAG + "LASER FPK WIDTH 5 GAP 40 OFFDELAY 30\nLASER MODE DUTY CARRIER 10 CHANNEL 1\n" + SPEEDS
        + "LASER POWER 20 CHANNEL 1\n" + both
    )  # fmt: skip
    first = tuned(text, f"{model}:250us", 0)
    second = tuned(text, f"{model}:250us", 1)
    assert isinstance(first, TuneResult)
    assert isinstance(second, TuneResult)
    assert first.statement == "LASER DELAY ON 210us OFF 220us CHANNEL 0"
    assert second.statement == "LASER DELAY ON 250us OFF 250us CHANNEL 1"
    for found, channel in ((first, 0), (second, 1)):
        assert (worst(found, channel)["on_miss_um"], worst(found, channel)["off_miss_um"]) == pytest.approx(
            (0, 0), abs=1e-3
        )
        assert worst(found, 1 - channel)["on_miss_um"] == pytest.approx(21 if channel else 25)


def test_the_channel_is_written_if_several_are_used() -> None:
    text = (
        "LASER MODE DUTY CARRIER 10 CHANNEL 0\nCHANNEL 1\nLASER DELAY ON 1 OFF 2 CHANNEL 0\nCHANNEL 0\n"
        + SPEEDS + AT_SPEED
    )  # fmt: skip
    assert statement(text, "delay:9us") == "LASER DELAY ON 9us OFF 9us CHANNEL 0"


@pytest.mark.parametrize("model", MODELS)
def test_no_more_than_the_controller_takes(model: str) -> None:
    text = DUTY + SPEEDS + "JUMP X -140\nLASER ON\nLINE X 50\nLASER OFF\nJUMP X 149\n"
    on_us, off_us = delays(text, f"{model}:60ms")
    assert 0 <= on_us <= off_us <= 65535


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("args", [(), ("--skywrite",)])
def test_a_scanner_that_lags_too_much_is_refused(tune: Tune, model: str, args: tuple[str, ...]) -> None:
    result = tune(MODE + BODY, *args, "--scanner", f"{model}:66ms")
    assert result.exit_code == 2
    assert ", 65535 us" in result.output


@pytest.mark.parametrize("model", FILTERS)
def test_a_slow_scanner_is_not_searched_us_by_us(model: str, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[float] = []
    miss = search._TargetPoints.miss_mm

    def counted(side: search._TargetPoints, delay_us: float) -> float:
        tried.append(delay_us)
        return miss(side, delay_us)

    monkeypatch.setattr(search._TargetPoints, "miss_mm", counted)
    delays(DUTY + SPEEDS + FROM_REST, f"{model}:65ms")
    assert len(tried) < 1500
    assert max(tried) <= 65535


@pytest.mark.parametrize("model", ["delay", "first-order"])
def test_the_jobs_own_delays_are_no_matter(model: str) -> None:
    """9 ms of on delay leave nothing of a mark of 5 ms, and 60 ms of off delay run it into the next."""
    marks = "JUMP X 1\nLASER ON\nLINE X 1.5\nLASER OFF\nJUMP X 3\nLASER ON\nLINE X 3.5\nLASER OFF\nJUMP X 5\n"
    for own in ("", "LASER DELAY ON 9000 OFF 9000\n", "LASER DELAY ON 9000 OFF 0\n", "LASER DELAY ON 0 OFF 60000\n"):
        assert delays(DUTY + own + SPEEDS + marks, f"{model}:250us") == (250, 250)


# SKYWRITE.


@pytest.mark.parametrize(
    ("lag", "nprev", "npost"), [("250us", 38, 25), ("100us", 15, 10), ("95us", 14, 10), ("1us", 0, 1)]
)
def test_sky_writing_for_a_pure_delay(lag: str, nprev: int, npost: int) -> None:
    found = tuned(DUTY + SPEEDS + FROM_REST, f"delay:{lag}", sky=True)
    assert isinstance(found, TuneResult)
    assert (found.statement, found.how) == (f"SKYWRITE MODE 3 TIMELAG {lag} NPREV {nprev} NPOST {npost}", CLOSED_FORM)
    assert (worst(found)["on_miss_um"], worst(found)["off_miss_um"]) == pytest.approx((0, 0), abs=1)


def test_shift_makes_up_for_the_gap() -> None:
    text = YAG + "LASER FPK WIDTH 5 GAP 40 OFFDELAY 30\n" + SPEEDS + FROM_REST
    assert statement(text, "delay:250us", sky=True) == "SKYWRITE MODE 3 TIMELAG 250us SHIFT -40us NPREV 38 NPOST 25"
    for model in FILTERS:
        after = worst(tuned(text, f"{model}:250us", sky=True))
        assert (after["on_miss_um"], after["off_miss_um"]) == pytest.approx((0, 0), abs=1)


@pytest.mark.parametrize("model", FILTERS)
@pytest.mark.parametrize(("vel", "acc"), [(100, 10_000), (2000, 1_000_000)])
def test_sky_writing_for_a_filter(model: str, vel: int, acc: int) -> None:
    """Within half a us of way at each end, a pulse at which the light is switched, and what a run-in is worth."""
    text = f"{DUTY}VEL {vel}\nACC {acc}\nLASER POWER 30\n{FROM_REST}"
    found = tuned(text, f"{model}:250us", sky=True)
    assert isinstance(found, TuneResult)
    assert found.how == SEARCH
    bound_um = vel / 1000 / 2 + 1 + 0.25
    assert abs(worst(found)["on_miss_um"]) < bound_um
    assert abs(worst(found)["off_miss_um"]) < bound_um
    before = run_text(found.run.source, lagging(f"{model}:250us"))
    assert before.marking == found.run.marking


def test_the_mode_and_the_limit_are_the_users() -> None:
    def with_own(own: str, mode: int | None = None) -> str:
        text = f"{DUTY}{own}\n{SPEEDS}JUMP X 1\n{FROM_REST}"
        return statement(text, "delay:250us", mode=mode, sky=True).replace("TIMELAG 250us NPREV 38 NPOST 25", "..")

    assert with_own("") == "SKYWRITE MODE 3 .."
    assert with_own("", 2) == "SKYWRITE MODE 2 .."
    assert with_own("SKYWRITE MODE 1 TIMELAG 9 SHIFT 3") == "SKYWRITE MODE 1 .."
    assert with_own("SKYWRITE MODE 1 TIMELAG 9", 2) == "SKYWRITE MODE 2 .."
    assert with_own("SKYWRITE MODE 3 TIMELAG 9 LIMIT (1/8)") == "SKYWRITE MODE 3 .. LIMIT 0.125"
    assert with_own("SKYWRITE MODE 3 TIMELAG 9 LIMIT 0.5", 1) == "SKYWRITE MODE 1 .."


@pytest.mark.parametrize("model", FILTERS)
def test_only_marks_that_are_sky_written_count(model: str) -> None:
    sky = "SKYWRITE MODE 3 TIMELAG 100us\nJUMP X 1\nLASER ON\nLINE X 5\nLASER OFF\n"
    rest = "SKYWRITE OFF\n" + "JUMP X 1\nLASER ON\nLINE X 3\nLASER OFF\n" * 5
    head = f"{DUTY}VEL 1000\nACC 1000000\nLASER POWER 30\n"
    assert statement(head + sky + rest, f"{model}:250us", sky=True) == statement(head + sky, f"{model}:250us", sky=True)


@pytest.mark.parametrize("model", FILTERS)
def test_a_run_in_that_finds_no_room_is_not_tried(model: str) -> None:
    """Two marks that speed up in 1 and in 50 ms want another SHIFT each, which only a longer run-in makes good. One
    begins 3 mm from the field's edge: there is room for 0.5 mm of speeding up and 2.25 mm at speed, not for 3 mm."""
    text = (
        f"{DUTY}VEL 1000\nACC 1000000\nLASER POWER 30\nJUMP X 147\nLASER ON\nLINE X 100\nLASER OFF\n"
        "JUMP X 0\nACC 20000\nLASER ON\nLINE X -90\nLASER OFF\n"
    )
    found = tuned(text, f"{model}:1.5ms", sky=True)
    assert isinstance(found, TuneResult)
    assert " NPREV 225 " in found.statement
    assert found.run.trace is not None
    free = tuned(text.replace("147", "130"), f"{model}:1.5ms", sky=True)
    assert isinstance(free, TuneResult)
    assert " NPREV 225 " not in free.statement
    assert worst(free)["on_miss_um"] < worst(found)["on_miss_um"] / 5


# What can't be tuned.


@pytest.mark.parametrize(
    ("text", "sky", "says"),
    [
        (DUTY, False, "channel 0 has no mark"),
        (DUTY + SPEEDS + "JUMP X 5\n", True, "channel 0 has no mark"),
        (DUTY + SPEEDS + "LASER ON\nLINE X 0\nLASER OFF\n", False, "channel 0 has no mark"),
        (DUTY + SPEEDS + "LASER ON\nDWELL 5\nLASER OFF\n", False, "no mark of channel 0 has a length"),
        (DUTY + SPEEDS + "LASER ON NOW\nDWELL 5\nLASER OFF NOW\n", False, "no mark of channel 0 is switched"),
        (DUTY + SPEEDS + "LASER ON\nLINE X 3\nWAIT\nLINE X 5\nLASER OFF\n", False, "no mark of channel 0 is switched"),
        (DUTY + "LASER DELAY ON 1 OFF 2\nLASER DELAY ON 1 OFF 3\n" + SPEEDS + FROM_REST, False, "in lines 2, 3"),
        (DUTY + SPEEDS + "SKYWRITE MODE 3 TIMELAG 9\n" + FROM_REST, False, "--skywrite"),
        (DUTY + "SKYWRITE OFF\n" + SPEEDS + FROM_REST, True, "a SKYWRITE OFF before the first mark"),
        (
            "REPEAT 2 AS i\nLASER MODE DUTY CARRIER 10 CHANNEL (i)\nLASER DELAY ON 1 OFF 2 CHANNEL (i)\nEND\n"
            + SPEEDS + FROM_REST, False, "more than one channel",
        ),
    ],
)  # fmt: skip
def test_a_reason_is_given_if_nothing_can_be_tuned(text: str, sky: bool, says: str) -> None:
    found = tuned(text, "delay:250us", sky=sky)
    assert isinstance(found, str)
    assert says in found


def test_a_scanner_that_does_not_lag_needs_no_sky_writing() -> None:
    found = tuned(DUTY + SPEEDS + FROM_REST, "first-order:0.4us", sky=True)
    assert isinstance(found, str)
    assert "has no lag" in found


# The command line, and the job's text.


Tune = Callable[..., Result]


@pytest.fixture
def tune(tmp_path: Path) -> Tune:
    """Write a job (or take the one there is), tune it for 77 us; never a traceback."""

    def invoke(data: bytes | None, *args: str, name: str = "a.job", scanner: str = "delay:77us") -> Result:
        path = tmp_path / name
        if data is not None:
            path.write_bytes(data)
        lag = ["--scanner", scanner] if scanner else []
        result = CliRunner().invoke(cli, ["tune", str(path), *lag, *args])
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        return result

    return invoke


TUNED = b"LASER DELAY ON 77us OFF 77us"
BODY = b"VEL 100\nACC 10000\nLASER POWER 30\nLASER ON\nLINE X 5\nLASER OFF\n"
MODE = b"LASER MODE DUTY CARRIER 10\n"
OWN = {
    "plain": MODE + b"<LASER DELAY ON 1us OFF 2us>\n" + BODY,
    "lower case, =, no blanks, comment": MODE + b"<laser delay on=1 off=2>;mine; LASER DELAY ON 1 OFF 2\n" + BODY,
    "tabs, blanks behind, //": MODE + b"\t \t<LASER\tDELAY\tON 1\tOFF 2>\t //\tmine\t \n\n\n" + BODY,
    "expressions": MODE + b"LET t = 5us\n<LASER DELAY OFF (2 * (t + 1us)) ON (t)> // (t)\n" + BODY,
    "in a loop": MODE + b"REPEAT 3\n  <LASER DELAY ON 1 OFF 2>\n" + BODY + b"  END\n",
    "in a routine": b"DEF go(t)\n  <LASER DELAY ON (t) OFF 20>\nEND\n" + MODE + b"CALL go(3)\nCALL go(4)\n" + BODY,
    "in a condition": MODE + b"IF 1 < 2\n<LASER DELAY ON 1 OFF 2>\nELSE\nLASER DELAY ON 7 OFF 7\nEND\n" + BODY,
    "CRLF": (MODE + b"  <LASER DELAY ON 1 OFF 2> ; mine\n" + BODY).replace(b"\n", b"\r\n"),
    "mixed line ends": MODE + b"<LASER DELAY ON 1 OFF 2>\r\n" + BODY.replace(b"\n", b"\r\n", 2),
    "BOM": b"\xef\xbb\xbf<LASER DELAY ON 1 OFF 2>\n" + MODE + BODY,
    "BOM, CRLF, first line": b"\xef\xbb\xbf" + (b"<LASER DELAY ON 1 OFF 2>\n" + MODE + BODY).replace(b"\n", b"\r\n"),
    "no line end at the end": MODE + b"<LASER DELAY ON 1 OFF 2>\n" + BODY[:-1],
    "other scripts": "; Übergröße 激光 😀\n".encode()
    + MODE
    + "<LASER DELAY ON 1 OFF 2> ; 😀é\u200bx\n".encode()
    + BODY,
    "CR": (MODE + b"  <LASER DELAY ON 1 OFF 2> ; mine\n" + BODY).replace(b"\n", b"\r"),
    "three line ends": MODE.replace(b"\n", b"\r") + b"<LASER DELAY ON 1 OFF 2>\r\n" + BODY,
}


@pytest.mark.parametrize("name", OWN)
def test_the_jobs_own_statement_is_replaced_and_nothing_else(tune: Tune, tmp_path: Path, name: str) -> None:
    head, own, behind = re.split(b"<(?=[Ll])|>", OWN[name], maxsplit=2)
    job = head + own + behind
    result = tune(job, "--write")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "a.job").read_bytes() == head + TUNED + behind


NEW = {
    "plain": MODE + b"<LASER DELAY>\n" + BODY,
    "far in, comment": b"\t  laser mode duty carrier 10 ; mine\n\t  <LASER DELAY>\n" + BODY,
    "in a loop": b"REPEAT 2\n  LASER MODE DUTY CARRIER 10\n  <LASER DELAY>\n" + BODY + b"END\n",
    "in a routine": b"DEF go()\n    LASER MODE DUTY CARRIER 10\n    <LASER DELAY>\nEND\nCALL go()\n" + BODY,
    "CRLF": (b"  LASER MODE DUTY CARRIER 10 \n  <LASER DELAY>\n" + BODY).replace(b"\n", b"\r\n"),
    "CR": (b"  LASER MODE DUTY CARRIER 10 \n  <LASER DELAY>\n" + BODY).replace(b"\n", b"\r"),
    "BOM": b"\xef\xbb\xbf" + MODE + b"<LASER DELAY>\n" + BODY,
    "the first of two": MODE + b"<LASER DELAY>\n" + BODY + b"LASER MODE DUTY2 CARRIER 20\nJUMP X 0\n" + BODY,
    "other scripts": "; 激光\n".encode() + MODE[:-1] + " ; 😀\n<LASER DELAY>\n; é".encode() + b"\n" + BODY[:-1],
}


@pytest.mark.parametrize("name", NEW)
def test_a_new_statement_goes_behind_the_mode(tune: Tune, tmp_path: Path, name: str) -> None:
    lines = re.split(rb"(?<=\n)|(?<=\r)(?!\n)", NEW[name])
    result = tune(b"".join(line for line in lines if b"<" not in line), "--write")
    assert result.exit_code == 0, result.output
    assert (tmp_path / "a.job").read_bytes() == NEW[name].replace(b"<LASER DELAY>", TUNED)


def test_a_new_statement_goes_behind_the_mode_of_its_channel(tune: Tune, tmp_path: Path) -> None:
    mode = b"LASER MODE DUTY CARRIER 10 CHANNEL 1\n"
    body = BODY.replace(b"30", b"30 CHANNEL 1").replace(b"LASER ON", b"LASER ON CHANNEL 1")
    body = body.replace(b"LASER OFF", b"LASER OFF CHANNEL 1")
    assert tune(MODE + mode + body, "--channel", "1", "--write").exit_code == 0
    assert (tmp_path / "a.job").read_bytes() == MODE + mode + TUNED + b" CHANNEL 1\n" + body


def test_to_tune_again_changes_nothing(tune: Tune, tmp_path: Path) -> None:
    assert tune(MODE + BODY, "--write").exit_code == 0
    once = (tmp_path / "a.job").read_bytes()
    assert tune(None, "--write").exit_code == 0
    assert (tmp_path / "a.job").read_bytes() == once


def test_sky_writing_is_written(tune: Tune, tmp_path: Path) -> None:
    wanted = b"SKYWRITE MODE 2 TIMELAG 77us NPREV 12 NPOST 8"
    assert tune(MODE + BODY, "--skywrite", "--mode", "2", "--write").exit_code == 0
    assert (tmp_path / "a.job").read_bytes() == MODE + wanted + b"\n" + BODY
    own = MODE + b" skywrite mode 2 timelag 5 ; mine\r\n" + BODY + b"SKYWRITE OFF\n"
    assert tune(own, "--skywrite", "--write").exit_code == 0
    assert (tmp_path / "a.job").read_bytes() == own.replace(b"skywrite mode 2 timelag 5", wanted)


def test_before_and_after_are_shown_and_nothing_is_written_unasked(tune: Tune, tmp_path: Path) -> None:
    result = tune(MODE + BODY)
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert lines[0].startswith("objective: ")
    assert lines[3] == TUNED.decode()
    assert lines[4].startswith("found by closed form, for the scanner delay:77us: ")
    table = {line.split("  ")[0]: line.split() for line in lines[5:]}
    assert table["marks"] == ["marks", "1", "1"]
    # Off 77 us early, 3 pulse/0.3 ms2 before rest: 10/2 * 0.077^2 = 0.0296 um.
    assert table["off miss"] == ["off", "miss", "um", "0.02964", "0", "0.02964", "0"]
    assert (tmp_path / "a.job").read_bytes() == MODE + BODY
    assert "search in the simulator" in tune(MODE + BODY, scanner="first-order:77us").output


# The objective and the verdict.


LINES = {
    "one mark": FROM_REST,
    "marks in a row": AT_SPEED + "JUMP X 20\nLASER ON\nLINE X 21\nLASER OFF\nLINE X 30\n",
    "a loop": "REPEAT 3 AS i\nJUMP X 0 Y (i)\nLASER ON\nLINE X (i + 1)\nLASER OFF\nEND\n",
    "a point between": "LASER ON\nLINE X 5\nLASER OFF\nLASER ON\nLINE X 5\nLASER OFF\n",
}


def measured(text: str, machine: Machine) -> tuple[int, float, float]:
    """Of channel 0, from the table of marks: their number, the RMS of their misses, and their emission."""
    source, _ = check_text(text.encode(), "test.job")
    assert source is not None
    run = run_text(source, machine)
    assert run.trace is not None
    marks = marks_of(run.trace, machine)
    long = marks["length_mm"] > 0.05
    misses = np.concatenate([marks[name][long] for name in ("on_miss_um", "off_miss_um")])
    emission = run.trace.channels[0].emission
    return int(long.sum()), float(np.sqrt(np.mean(misses**2))), float((emission.end_ms - emission.start_ms)[long].sum())


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("path", LINES.values(), ids=LINES)
def test_what_is_written_is_never_worse_than_what_was_there(tune: Tune, tmp_path: Path, model: str, path: str) -> None:
    machine, rng = lagging(f"{model}:77us"), random.Random(path)
    for _ in range(4):
        on, off = sorted(rng.choice((0, 60, 76, 77, 78, 90, 300)) for _ in range(2))
        job = f"{DUTY}LASER DELAY ON {on} OFF {off}\n{SPEEDS}{path}"
        result = tune(job.encode(), "--write", scanner=f"{model}:77us")
        assert result.exit_code == 0, result.output
        after = (tmp_path / "a.job").read_text(encoding="utf-8")
        (old_marks, old_um, old_ms), (new_marks, new_um, new_ms) = (measured(text, machine) for text in (job, after))
        assert ("nothing to gain: unchanged" in result.output) == (after == job)
        if after != job:
            assert new_marks >= old_marks
            # Nearer by more than a pulse, or within a pulse with less emission, or else nearer.
            assert new_um < old_um - 1 or (new_um <= old_um + 1 and (new_ms < old_ms or new_um < old_um))


def test_values_that_are_as_good_stay(tune: Tune, tmp_path: Path) -> None:
    job = MODE + b"laser delay on = (70 + 7) off=77 ; mine\n" + BODY
    result = tune(job, "--write")
    assert result.exit_code == 0
    assert result.output.splitlines()[-1].startswith("nothing to gain: unchanged; ")
    assert "written" not in result.output
    assert (tmp_path / "a.job").read_bytes() == job


def test_an_end_that_becomes_worse_is_named_with_the_reason(tune: Tune) -> None:
    # On at S while the beam rests there: the off delay is wrong by 50 us, and the later on delay costs less than 1 um.
    result = tune(MODE + b"LASER DELAY ON 0 OFF 27\n" + BODY.replace(b"LINE X 5\n", b"LINE X 5\nJUMP X 9\n", 1).replace(
        b"JUMP X 9\nLASER OFF", b"LASER OFF\nJUMP X 9"), scanner="first-order:77us")  # fmt: skip
    worse = [line for line in result.output.splitlines() if line.startswith("worse: ")]
    assert worse
    assert all(line.endswith("which is within the tolerance") for line in worse)
    assert "on miss of channel 0 (worst) rises from 0 to " in "".join(worse)


def test_sky_writing_counts_the_marks_of_both_channels(tune: Tune) -> None:
    """The first pulse killer of channel 1 delays its emission by 50 us: with its SHIFT channel 0 is 20 um off."""
    text = (
        "LASER MODE DUTY CARRIER 10\nLASER MODE DUTY CARRIER 10 CHANNEL 1\n"
        "LASER FPK WIDTH 15 GAP 50 OFFDELAY 10 CHANNEL 1\nLASER POWER 30\nLASER POWER 30 CHANNEL 1\n"
        "VEL 400\nACC 300000\n"
        "SKYWRITE MODE 2 TIMELAG 100us NPREV 15 NPOST 10\nJUMP X 0 Y 1\nLASER ON\nLINE X 5\nLASER OFF\n"
        "JUMP X 10\nLASER ON CHANNEL 1\nLINE X 15\nLASER OFF CHANNEL 1\n"
    )
    found = tune(text.encode(), "--skywrite", "--channel", "1", "--format", "json", scanner="delay:100us")
    content = json.loads(found.stdout)
    assert content["objective"]["channels"] == [0, 1]
    # Before: 20 um at one of four ends. After: -20 um at another one.
    assert content["before"]["rms_um"] == pytest.approx(10, rel=0.02)
    assert content["after"]["rms_um"] == pytest.approx(10, rel=0.02)
    assert {end["channel"] for end in content["verdict"]["worse"]} == {0}


def test_marks_that_the_delays_join_are_won(tune: Tune) -> None:
    """The jump of 0.1 mm takes 1 ms."""
    job = MODE + b"LASER DELAY ON 0us OFF 9000us\n" + BODY + b"JUMP X 5.1\nLASER ON\nLINE X 10\nLASER OFF\n"
    result = tune(job)
    assert result.exit_code == 0
    assert "better: the job then has 2 marks, not 1" in result.output


def test_json_has_everything_in_full(tune: Tune, tmp_path: Path) -> None:
    job = MODE + b"LASER DELAY ON 0 OFF 27\n" + BODY
    result = tune(job, "--format", "json", "--write")
    content = json.loads(result.stdout)
    assert content["schema"] == "gusjob-tune/1"
    assert content["statement"] == TUNED.decode()
    assert content["written"] is True
    assert content["objective"]["ends"] == ["on_miss_um", "off_miss_um"]
    assert content["objective"]["scanner"] == "delay:77us"
    # Off 50 us early, at rest 77 us later: 10 pulse/ms2 / 2 * (0.05 ms)^2 = 0.0125 um, at one of two ends.
    assert content["before"]["rms_um"] == pytest.approx(0.0125 / math.sqrt(2))
    assert content["before"]["totals"][0]["worst"]["off_miss_um"] == pytest.approx(0.0125)
    assert content["after"]["rms_um"] == 0
    assert content["verdict"]["gain"] is True
    again = json.loads(tune(None, "--format", "json", "--write").stdout)
    assert (again["written"], again["verdict"]["gain"], again["verdict"]["reason"]) == (False, False, "equal")


def test_each_unit_of_power_has_its_table(tune: Tune) -> None:
    other = b"LASER MODE ANALOG MAX 10\nLASER POWER 5\nLASER ON\nLINE X 9\nLASER OFF\n"
    output = tune(MODE + BODY + other).output
    assert "%·ms/mm" in output
    assert "V·ms/mm" in output


def test_the_scanner_may_be_the_profiles(tune: Tune, tmp_path: Path) -> None:
    (tmp_path / "gusjob.toml").write_text('scanner = "delay:33us"\n', encoding="utf-8")
    assert "ON 33us OFF 33us" in tune(MODE + BODY, scanner="").output
    assert "ON 77us OFF 77us" in tune(MODE + BODY).output


@pytest.mark.parametrize(
    ("data", "args", "code", "says"),
    [
        (MODE + BODY, {"scanner": ""}, 2, "no scanner is set"),
        (b"GT_LaserPowerMode(0,100,0,0)\n", {"name": "a.gts"}, 2, "this is a listing"),
        (MODE + BODY + b"LINE X\n", {}, 1, "GJ1"),
        (MODE + BODY + b"LASER ON\n", {}, 1, "GJ401"),
        (MODE + b"LOOKAHEAD OFF\nVEL 100\nACC 1\nLINE X 1 END 99\n", {}, 1, "GJ506"),
        (MODE + BODY.replace(b"100\n", b"1e-9\n").replace(b"10000", b"1e-9"), {}, 1, "GJ713"),
        (b"\0", {}, 2, "GJ002"),
        (None, {}, 2, "GJ001"),
        (b"", {}, 2, "has no mark"),
        (MODE, {}, 2, "has no mark"),
        (MODE + b"LASER DELAY ON 1 OFF 2\n" * 2 + BODY, {}, 2, "in lines 2, 3"),
    ],
)
def test_refusals(tune: Tune, tmp_path: Path, data: bytes, args: dict[str, str], code: int, says: str) -> None:
    result = tune(data, "--write", **args)
    assert result.exit_code == code
    assert says in result.output
    assert "Traceback" not in result.output
    path = tmp_path / args.get("name", "a.job")
    assert (path.read_bytes() if path.exists() else None) == data


@pytest.mark.parametrize(("args", "says"), [(["--mode", "1"], "--skywrite"), (["--channel", "2"], "0<=x<=1")])
def test_wrong_usage(tune: Tune, args: list[str], says: str) -> None:
    result = tune(MODE + BODY, *args)
    assert result.exit_code == 2
    assert says in result.output


def test_a_statement_with_which_the_job_has_errors_is_not_written(tune: Tune, tmp_path: Path) -> None:
    """No room for a run-in: S is 0.01 mm from the field's edge."""
    job = MODE + BODY.replace(b"LASER ON\nLINE X 5", b"JUMP X 149.99\nLASER ON\nLINE X 140")
    result = tune(job, "--skywrite", "--write")
    assert result.exit_code == 1
    assert "GJ808" in result.output
    assert "nothing is written" in result.output
    assert (tmp_path / "a.job").read_bytes() == job


@pytest.mark.parametrize("what", [b"LASER DELAY ON 1 OFF 2\n", b""])
def test_an_included_file_is_left_alone(tune: Tune, tmp_path: Path, what: bytes) -> None:
    (tmp_path / "setup.inc").write_bytes(MODE + what)
    job = b'INCLUDE "setup.inc"\n' + BODY
    result = tune(job, "--write")
    assert result.exit_code == 0
    statement = result.output.splitlines()[3].encode()
    assert (tmp_path / "a.job").read_bytes() == b'INCLUDE "setup.inc"\n' + statement + b"\n" + BODY
    assert (tmp_path / "setup.inc").read_bytes() == MODE + what
    # Once more it is replaced, and not put in again.
    assert tune((tmp_path / "a.job").read_bytes(), "--write").exit_code == 0
    assert (tmp_path / "a.job").read_bytes().count(b"LASER DELAY") == 1


def test_an_included_file_that_sets_it_again_is_refused(tune: Tune, tmp_path: Path) -> None:
    (tmp_path / "setup.inc").write_bytes(MODE + b"LASER DELAY ON 1 OFF 2\n")
    result = tune(MODE + b'LASER DELAY ON 5 OFF 6\nINCLUDE "setup.inc"\n' + BODY, "--write")
    assert result.exit_code == 2
    assert "sets LASER DELAY again after line" in result.output


def test_a_files_mode_and_a_link_to_it_stay(tune: Tune, tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    real = tmp_path / "real" / "b.job"
    real.write_bytes(MODE + BODY)
    real.chmod(0o640)
    kept = real.stat().st_mode
    try:
        (tmp_path / "a.job").symlink_to(real)
    except OSError:
        pytest.skip("this system makes no links")
    assert tune(None, "--write").exit_code == 0
    assert (tmp_path / "a.job").is_symlink()
    assert real.read_bytes() == MODE + TUNED + b"\n" + BODY
    assert real.stat().st_mode == kept
    assert [p.name for p in real.parent.iterdir()] == ["b.job"]


def refuse(*_: object, **__: object) -> NoReturn:
    raise PermissionError(13, "Permission denied")


@pytest.mark.parametrize("where", ["the folder", "the last step"])
def test_a_failed_write_is_reported_and_leaves_nothing(
    tune: Tune, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    if where == "the folder":
        monkeypatch.setattr(tempfile, "mkstemp", refuse)
    else:
        monkeypatch.setattr(Path, "replace", refuse)
    result = tune(MODE + BODY, "--write")
    assert result.exit_code == 2
    assert "can't write: permission denied" in result.output
    assert "written to" not in result.output
    assert [p.name for p in tmp_path.iterdir()] == ["a.job"]
    assert (tmp_path / "a.job").read_bytes() == MODE + BODY


def test_a_read_only_job_stays(tune: Tune, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "access", lambda _, mode: mode != os.W_OK)
    result = tune(MODE + BODY, "--write")
    assert result.exit_code == 2
    assert "can't write: permission denied" in result.output
    assert (tmp_path / "a.job").read_bytes() == MODE + BODY


def test_a_job_that_changed_meanwhile_stays(tune: Tune, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def touched(*args: Any) -> Any:
        (tmp_path / "a.job").write_bytes(b"; new\n")
        return tune_delays(*args)

    monkeypatch.setattr("gusjob.tune.tune_delays", touched)
    result = tune(MODE + BODY, "--write")
    assert result.exit_code == 2
    assert "the file was changed" in result.output
    assert (tmp_path / "a.job").read_bytes() == b"; new\n"


def test_every_model_is_tuned() -> None:
    assert {model.value for model in ScannerModel} == set(MODELS)


@pytest.mark.parametrize(("name", "args"), [("hatch_delays", ()), ("hatch_skywrite", ("--skywrite", "--mode", "2"))])
def test_the_examples_are_what_tune_says(name: str, args: tuple[str, ...]) -> None:
    folder = ROOT / "jobs" / "skywriting"
    result = CliRunner().invoke(cli, ["tune", str(folder / "hatch_plain.job"), *args])
    assert result.exit_code == 0
    assert result.output.splitlines()[3] in (folder / f"{name}.job").read_text(encoding="utf-8").splitlines()
