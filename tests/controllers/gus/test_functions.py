"""The table of the sister library's functions, against calls.py, the rules of C++ and facts of the header."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import pytest

from gusjob.controllers.gus import functions as module
from gusjob.controllers.gus.calls import HOST_CALLS, SIGNATURES, Signature
from gusjob.controllers.gus.functions import GSN_SAME_FORM, Effect, functions

LINES = [
    line
    for line in Path(module.__file__).with_name("functions.txt").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
]


def test_each_line_is_one_function_in_order() -> None:
    names = [line.split("(")[0].split()[1] for line in LINES]
    assert names == sorted(set(names))
    assert list(functions()) == names


def test_the_count() -> None:
    """418 of the header, and GT_BufLaserPrfFollow of M."""
    assert len(functions()) == 419
    assert Counter(f.effect.value for f in functions().values()) == {
        "laser": 25,
        "path": 108,
        "read": 123,
        "host": 58,
        "output": 26,
        "other": 79,
    }


SISTER_DIFFERS = {
    "GT_LaserPowerMode": ["short", "double", "double", "short", "short"],  # One argument more: delaymode.
    "GT_SetPulseWidth": ["unsigned long", "short"],  # M: unsigned short.
}


@pytest.mark.parametrize("signature", [*SIGNATURES.values(), *HOST_CALLS.values()], ids=lambda s: s.name)
def test_calls_have_the_same_arguments(signature: Signature) -> None:
    of_calls = [arg.declaration.removesuffix(arg.name).rstrip() for arg in signature.args]
    of_table = [arg.c_type for arg in functions()[signature.name].args]
    assert of_table == SISTER_DIFFERS.get(signature.name, of_calls)
    assert (of_table != of_calls) is (signature.name in SISTER_DIFFERS)


def test_arguments_with_defaults_come_last() -> None:
    """C++ demands it."""
    for function in functions().values():
        given = [arg.default is None for arg in function.args]
        assert given == sorted(given, reverse=True), function


def test_names_of_arguments_are_unique() -> None:
    for function in functions().values():
        assert len({arg.name for arg in function.args}) == function.most, function


@pytest.mark.parametrize(
    ("name", "least", "most"),
    [
        ("GT_LnXY", 5, 7),
        ("GT_ArcXYC", 8, 10),
        ("GT_HelixXYRZ", 9, 10),
        ("GT_HelixXYRZWN", 8, 11),
        ("GT_Open", 0, 2),
        ("GT_Close", 0, 0),
        ("GT_BufLaserOn", 1, 3),
        ("GT_CrdClear", 2, 2),
        ("GT_LaserPowerMode", 3, 5),
        ("GT_BufLaserPrfFollow", 4, 6),
    ],
)
def test_least_and_most_arguments(name: str, least: int, most: int) -> None:
    assert (functions()[name].least, functions()[name].most) == (least, most)


def test_defaults() -> None:
    def defaults(name: str) -> list[float | None]:
        return [arg.default for arg in functions()[name].args]

    assert defaults("GT_Open") == [0, 1]
    assert defaults("GT_LmtsOn") == [None, -1]
    assert defaults("GT_GetSts") == [None, None, 1, 0]
    assert defaults("GT_SetGearMaster") == [None, None, 2, 0]
    assert defaults("GT_InitLookAhead") == [None] * 6


def test_types() -> None:
    def types(name: str) -> list[str]:
        return [arg.c_type for arg in functions()[name].args]

    assert types("GT_GetVersion") == ["char **"]
    assert types("GT_InitLookAhead") == ["short", "short", "double", "double", "short", "TCrdData *"]
    assert types("GT_GetClock") == ["unsigned long *", "unsigned long *"]


@pytest.mark.parametrize(
    ("effect", "names"),
    [
        (Effect.LASER, "GT_BufLaserOn GT_BufLaserFollowSpline GT_SetHSIOOpt GT_SetAxisMode GT_SetLaserMode"),
        (Effect.PATH, "GT_LnXYG0WN GT_BufIO GT_BufMove GT_Stop GT_SetOverride GT_InitLookAhead GT_SetCrdPrm"),
        (Effect.READ, "GT_GetCrdPos GT_CrdStatus GT_CrdSpace GT_HomeSts GT_GetHSIOOpt GT_GetLaserOnTime"),
        (Effect.HOST, "GT_Open GT_LoadConfig GT_AxisOn GT_ClrSts GT_LmtsOff GT_EncOn GT_SetCaptureMode"),
        (Effect.OUTPUT, "GT_SetDo GT_SetDoBit GT_SetDac GT_ComparePulse GT_2DCompareData GT_SetExtIoBit"),
        (Effect.OTHER, "GT_ZeroPos GT_SetPrfPos GT_SynchAxisPos GT_PrfTrap GT_Update GT_GoHome GT_PvtStart"),
    ],
)
def test_effects(effect: Effect, names: str) -> None:
    assert {functions()[name].effect for name in names.split()} == {effect}


def test_all_that_only_gets_is_read() -> None:
    for name, function in functions().items():
        assert (function.effect is Effect.READ) or not name.startswith("GT_Get"), name
        assert (function.effect is Effect.READ) is False or any("*" in arg.c_type for arg in function.args), name


def test_what_the_model_knows_acts_on_laser_or_path() -> None:
    others = {"GT_GetHSIOOpt", "GT_CrdStatus", "GT_Reset"}
    for name in SIGNATURES:
        assert (functions()[name].effect in (Effect.LASER, Effect.PATH)) is (name not in others), name


def test_only_the_buffered_follow_is_of_the_laser_manual_alone() -> None:
    assert {f.name: f.section for f in functions().values() if f.section != "sister"} == {
        "GT_BufLaserPrfFollow": "四.2"
    }


def test_gsn() -> None:
    """Calls for which GSN has no function: those of the switch line, of pulses and voltage, and M's follows."""
    assert SIGNATURES.keys() - GSN_SAME_FORM == {
        "GT_BufLaserPrfFollow",
        "GT_SetAxisMode",
        "GT_SetHSIOOpt",
        "GT_GetHSIOOpt",
        "GT_SetWaitPulse",
        "GT_SetPreVltg",
        "GT_EnaFPK",
        "GT_DisFPK",
        "GT_SetLaserDisMode",
        "GT_SetLaserDisRatio",
    }
    assert SIGNATURES.keys() >= GSN_SAME_FORM
