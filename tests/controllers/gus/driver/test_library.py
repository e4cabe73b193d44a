"""The ABIs against the vendor's header, and libraries that do not fit."""

from __future__ import annotations

import ctypes
import re
from pathlib import Path

import pytest
from support.controller import CC, GUS, Fault, needs_controller
from support.hardware import EVERYTHING, Bench, bench
from support.tools import MARK, ROOT, stream_of

from gusjob.config.machine import Abi, Machine
from gusjob.controllers.gus.calls import CRD_FIELDS, HOST_CALLS, SIGNATURES
from gusjob.controllers.gus.driver.abi import TCrdPrm, prototypes
from gusjob.controllers.gus.driver.library import load_library
from gusjob.controllers.gus.driver.requirements import needed_calls

pytestmark = needs_controller


def test_prototypes_are_those_of_the_vendors_header() -> None:
    header = (ROOT / "tests" / "vendor" / "gts.h").read_text(encoding="ascii")
    found = dict(re.findall(r"^short (GT_\w+)\(([^;]*)\);", re.sub(r"\s+", " ", header).replace("; ", ";\n"), re.M))

    def types(arguments: str) -> list[str]:
        return (
            []
            if arguments == "void"
            else [re.sub(r"(\*?)\s*\w+$", r"\1", a.strip()).replace(" ", "") for a in arguments.split(",")]
        )

    for name, arguments in found.items():
        signature = (SIGNATURES | HOST_CALLS)[name]
        ours = signature.prototype.partition("(")[2][:-1]
        assert types(ours) == types(arguments), name
    assert found.keys() >= SIGNATURES.keys()


def test_the_parameters_are_laid_out_as_the_compiler_does(tmp_path: Path) -> None:
    """offsetof and sizeof by the C compiler, through a library of its own."""
    import subprocess

    fields = [name for name, *_ in CRD_FIELDS]
    source = tmp_path / "layout.c"
    exprs = ",".join(f"offsetof(TCrdPrm,{name})" for name in fields)
    source.write_text(
        f'#include <stddef.h>\n#include "gts.h"\nconst unsigned long layout[] = {{sizeof(TCrdPrm),{exprs}}};\n',
        encoding="ascii",
    )
    library = tmp_path / "layout.so"
    assert CC is not None
    include = str(ROOT / "tests" / "vendor")
    subprocess.run([CC, "-shared", "-fPIC", "-I", include, str(source), "-o", str(library)], check=True)
    found = list((ctypes.c_ulong * (len(fields) + 1)).in_dll(ctypes.CDLL(str(library)), "layout"))
    assert found == [ctypes.sizeof(TCrdPrm), *(getattr(TCrdPrm, name).offset for name in fields)]


def test_what_the_abis_differ_in() -> None:
    gus, gts, multi = (prototypes(abi, 3) for abi in (Abi.GUS, Abi.GTS, Abi.GTS_MULTI))
    counts = [
        [len(p[name].argtypes) for p in (gus, gts, multi)] for name in ("GT_LaserPowerMode", "GT_Close", "GT_LnXY")
    ]
    assert counts == [[4, 5, 6], [0, 0, 1], [7, 7, 8]]
    assert [p["GT_SetPulseWidth"].argtypes[-2] for p in (gus, gts)] == [ctypes.c_ushort, ctypes.c_ulong]
    assert [p["GT_BufLaserPrfFollow"].symbol for p in (gus, gts)] == ["GT_BufLaserPrfFollow", "GT_BufLaserFollowRatio"]
    assert multi["GT_LnXY"].leading == (3,)


@pytest.mark.parametrize(("library", "profile"), [(a, b) for a in range(3) for b in range(3) if a != b])
def test_a_wrong_abi_is_detected_before_any_laser_call(benches: dict[int, Bench], library: int, profile: int) -> None:
    stream = stream_of(EVERYTHING)
    made, abi = benches[library], (Abi.GUS, Abi.GTS, Abi.GTS_MULTI)[profile]
    made.controller.reset()
    machine = made.machine(Machine(), abi=abi)
    loaded, faults = load_library(str(made.path), abi, 0, needed_calls(stream, machine))
    if loaded is None:
        codes = [fault.rule.code for fault in faults]
        assert f"--abi {abi}" in faults[0].message
    else:
        codes = made.run(stream, machine).codes
    assert codes == ["GJ903"]
    names = set(made.controller.names())
    assert names <= {"GT_Open", "GT_ClrSts"}
    assert not any(made.controller.state().switched_on)


def test_missing_symbols_are_one_clear_error(tmp_path: Path) -> None:
    made = bench(tmp_path, GUS, "-DVC_NO_FOLLOW")
    stream, machine = stream_of(EVERYTHING), made.machine(Machine())
    library, (fault,) = load_library(str(made.path), Abi.GUS, 0, needed_calls(stream, machine))
    assert library is None
    assert fault.rule.code == "GJ902"
    assert all(part in fault.message for part in (str(made.path), "--abi gus", "GT_BufLaserPrfFollow"))
    assert made.controller.calls() == []
    # A job that does not follow does without.
    plainer = stream_of(MARK + "LASER POWER 3\nLASER ON\nLINE X 1\nLASER OFF\n")
    assert load_library(str(made.path), Abi.GUS, 0, needed_calls(plainer, machine))[1] == []


@pytest.mark.parametrize(
    ("name", "said"), [("no/such.so", "no such file"), ("libnosuch.so", "such file"), ("text.so", "")]
)
def test_a_library_that_can_not_be_loaded(tmp_path: Path, name: str, said: str) -> None:
    (tmp_path / "text.so").write_text("no library", encoding="ascii")
    path = name if name == "libnosuch.so" else str(tmp_path / name)
    library, (fault,) = load_library(path, Abi.GUS, 0, [])
    assert library is None
    assert fault.rule.code == "GJ901"
    assert said in fault.message


def test_a_library_without_the_calls_is_refused() -> None:
    from ctypes.util import find_library

    if not (name := find_library("m")):
        pytest.skip("no library to be found")
    _, (fault,) = load_library(name, Abi.GUS, 0, ["GT_Open", "GT_Close", "GT_LnXY", "GT_CrdClear"])
    assert fault.rule.code == "GJ902"
    assert "not a Googol library" in fault.message


def test_a_link_that_fails_at_the_probe_is_no_wrong_library(gus: Bench) -> None:
    gus.controller.fault(Fault.RETURN, "GT_ClrSts", 1, 1, -7)
    ran = gus.run(stream_of(MARK + "LINE X 5\n"), gus.machine(Machine()))
    assert ran.codes == ["GJ904"]
    assert "cable" in ran.faults[0].message
