"""What a computer could run on: real libraries of every ABI, files that are none, and fake USB devices."""

from __future__ import annotations

import array
import ctypes
import ctypes.util
import errno
import json
import os
import shutil
import struct
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from click.testing import CliRunner, Result
from support.controller import GTS, GTS_MULTI, GUS, build, needs_controller

from gusjob.cli.devices_command import command
from gusjob.config.machine import Abi
from gusjob.controllers.gus.driver import headers, inspection
from gusjob.controllers.gus.driver.inspection import inspect_library
from gusjob.controllers.gus.driver.library import BITS
from gusjob.hardware import devices
from gusjob.hardware.devices import usb
from gusjob.hardware.devices.libraries import SearchPaths, find_libraries, search_paths
from gusjob.hardware.devices.usb import UsbProblemKind, find_usb_devices

NOWHERE = SearchPaths(names=("libgus.so", "libgts.so"), folders=())
FOLLOW, RATIO = "GT_BufLaserPrfFollow", "GT_BufLaserFollowRatio"
REAL_BACKEND = usb.usb_backend


def run(*args: object) -> Result:
    return CliRunner().invoke(command, [str(a) for a in args], catch_exceptions=False)


def data(*args: object) -> Any:
    return json.loads(run("--format", "json", *args).stdout)


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder without a profile, a search that finds nothing, no USB."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(devices, "search_paths", lambda: NOWHERE)
    monkeypatch.setattr(usb, "usb_backend", Bus)
    return tmp_path


# Vendor libraries.

Made = Callable[..., Path]
"""A library of an ABI with flags, as build() makes it, compiled once."""


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    return cache(partial(build, tmp_path_factory.mktemp("libraries")))


@needs_controller
@pytest.mark.parametrize(
    ("abi", "flags", "fits", "missing"),
    [
        (GUS, (), {Abi.GUS}, {Abi.GTS: (RATIO,), Abi.GTS_MULTI: (RATIO,)}),
        (GTS, (), {Abi.GTS, Abi.GTS_MULTI}, {Abi.GUS: (FOLLOW,)}),
        (GTS_MULTI, (), {Abi.GTS, Abi.GTS_MULTI}, {Abi.GUS: (FOLLOW,)}),
        (GUS, ("-DVC_NO_FOLLOW",), set(Abi), {}),
    ],
)
def test_a_library_fits_its_abis(
    made: Made, abi: int, flags: Sequence[str], fits: set[Abi], missing: dict[Abi, tuple[str, ...]]
) -> None:
    found = inspect_library(str(made(abi, *flags)))
    assert (found.loaded, found.reason, found.next_steps) == (True, "", ())
    assert (set(found.abis), found.missing) == (fits, missing)


@needs_controller
def test_no_call_is_made(made: Made) -> None:
    path = made(GUS)
    assert inspect_library(str(path)).loaded
    assert ctypes.CDLL(str(path)).vc_calls() == 0


@needs_controller
def test_a_library_without_laser_calls_lists_what_it_lacks(made: Made) -> None:
    path = made(GTS, "-DGT_LaserPowerMode=GT_Another", "-DGT_BufLaserOn=GT_AnotherOne")
    found = inspect_library(str(path))
    assert (found.loaded, found.abis) == (True, ())
    assert "calls are missing" in found.reason
    assert found.missing[Abi.GTS] == ("GT_LaserPowerMode", "GT_BufLaserOn")
    assert found.missing[Abi.GUS] == ("GT_LaserPowerMode", "GT_BufLaserOn", FOLLOW)
    assert "for gts it lacks GT_LaserPowerMode, GT_BufLaserOn\n" in run("--library", path).output


def test_another_library_can_not_be_used() -> None:
    name = ctypes.util.find_library("m") or ctypes.util.find_library("c") or ctypes.util.find_library("kernel32")
    if name is None:
        pytest.skip("needs a library of the system that can be found by name")
    found = inspect_library(name)
    assert (found.loaded, found.abis, found.missing) == (True, (), {})
    assert found.reason == "it does not have the calls of a Googol library"
    assert found.next_steps


def test_a_text_is_no_library(tmp_path: Path) -> None:
    path = tmp_path / "libgts.so"
    path.write_text("This is not a library, however it is called.\n" * 100, encoding="utf-8")
    found = inspect_library(str(path))
    assert not found.loaded
    assert found.reason
    if sys.platform == "linux":
        assert found.reason == "invalid ELF header"
        assert found.next_steps == ("copy it again from the vendor's package, the one for this system",)


@needs_controller
@pytest.mark.skipif(sys.platform != "linux", reason="needs ELF files")
@pytest.mark.parametrize("share", [0.0005, 0.002, 0.1, 0.5])
def test_a_truncated_library_is_not_loaded(made: Made, tmp_path: Path, share: float) -> None:
    whole = made(GUS).read_bytes()
    path = tmp_path / "libgus.so"
    path.write_bytes(whole[: int(share * len(whole))])
    found = inspect_library(str(path))
    assert (found.loaded, found.reason) == (False, "the file is truncated")
    assert "copy it again" in found.next_steps[0]


@pytest.mark.parametrize("wide", [True, False])
@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("there", [-1, 0, 1])
def test_a_part_must_be_there_to_its_last_byte(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wide: bool, order: str, there: int
) -> None:
    begin, length = 200, 56
    head = struct.pack(order + "4sBB10xHHI", b"\x7fELF", 2 if wide else 1, 1 if order == "<" else 2, 3, 62, 1)
    head += struct.pack(order + ("QQQ" if wide else "III"), 0, 64, 0)
    head += struct.pack(order + "IHHH", 0, 64, 56 if wide else 32, 2)
    # The first row is no PT_LOAD: how far it reaches does not matter.
    form, fields = (
        ("IIQQQQQQ", (0, begin, 0, 0, length, length, 1)) if wide else ("IIIIIIII", (begin, 0, 0, length, length, 0, 1))
    )
    rows = struct.pack(order + form, 4, *(9999 if field else 0 for field in fields)) + struct.pack(
        order + form, 1, *fields
    )
    path = tmp_path / "libgus.so"
    path.write_bytes((head.ljust(64, b"\0") + rows).ljust(begin + length + there, b"\0"))
    monkeypatch.setattr(headers, "own_header", lambda: None)
    monkeypatch.setattr(ctypes, "WinDLL" if sys.platform == "win32" else "CDLL", _refusing)
    assert inspect_library(str(path)).reason == ("the file is truncated" if there < 0 else "the loader's word")


def _refusing(_path: str) -> None:
    raise OSError("the loader's word")


@needs_controller
@pytest.mark.skipif(sys.platform != "linux", reason="needs ELF files")
def test_a_library_for_other_bits(made: Made, tmp_path: Path) -> None:
    whole = bytearray(made(GUS).read_bytes())
    # ELFCLASS32 for 64 or the other way round; no row in the table of parts, which is of the other size.
    whole[4] = 3 - whole[4]
    whole[42:46] = whole[54:58] = bytes(4)
    whole[28:40] = bytes(12)
    path = tmp_path / "libgus.so"
    path.write_bytes(whole)
    found = inspect_library(str(path))
    assert "wrong ELF class" in found.reason
    assert f"{BITS} bits" in found.next_steps[0]


@pytest.mark.parametrize(
    ("error", "step"),
    [
        ("libgts.so: cannot open shared object file: Permission denied", "chmod"),
        ("libhost.so.1: cannot open shared object file: No such file or directory", "ldd"),
        ("libgts.so: undefined symbol: host_open", "ldd"),
        ("Could not find module 'C:\\gts.dll' (or one of its dependencies).", "driver package"),
        ("[WinError 5] Access is denied", "read and execute it"),
        ("something that nobody has seen", ""),
    ],
)
def test_each_reason_has_its_next_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: str, step: str) -> None:
    path = tmp_path / "libgts.so"
    path.touch()
    monkeypatch.setattr(inspection, "open_library", lambda _: error)
    found = inspect_library(str(path))
    assert not found.loaded
    assert error.endswith(found.reason)
    assert found.next_steps == () if not step else step in found.next_steps[0]


@pytest.mark.parametrize("name", ["", "nul\0here.so", "no/such/libgts.so", "libnosuchthing.so"])
def test_what_is_not_there(name: str) -> None:
    found = inspect_library(name)
    assert not found.loaded
    assert "no such file" in found.reason or sys.platform != "linux"


def test_a_folder_is_no_library(tmp_path: Path) -> None:
    (tmp_path / "libgts.so").mkdir()
    assert inspect_library(str(tmp_path / "libgts.so")).reason == "it is a folder, not a library"
    assert find_libraries((), SearchPaths(names=("libgts.so",), folders=(str(tmp_path),))) == ()


@needs_controller
def test_each_library_is_listed_once_the_named_ones_first(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = made(GUS), made(GTS)
    monkeypatch.chdir(second.parent)
    folder = tmp_path / "lib"
    folder.mkdir()
    (folder / "libgus.so").symlink_to(first)
    (folder / "libgts.so").symlink_to(second)
    search = SearchPaths(names=("libgus.so", "libgts.so"), folders=(str(folder), str(folder)))
    found = find_libraries((second.name, str(second)), search)
    assert [library.path for library in found] == [str(second), str(folder / "libgus.so")]


def test_the_loader_finds_what_is_in_no_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ctypes.util, "find_library", {"gts": "libgts.so.7"}.get)
    assert [
        library.path for library in find_libraries((), SearchPaths(names=NOWHERE.names, folders=(), system=True))
    ] == ["libgts.so.7"]
    assert find_libraries((), NOWHERE) == ()


def test_the_current_folder_is_not_searched(tmp_path: Path) -> None:
    (tmp_path / "libgts.so").touch()
    for entries in ("", ".", "sub/..", f"{os.pathsep}."):
        search = search_paths("linux", {"LD_LIBRARY_PATH": entries})
        assert all(Path(folder).is_absolute() for folder in search.folders)
        assert search.system == (entries == "")  # An empty entry among others is the current folder, too.
    assert str(tmp_path) in search_paths("linux", {"LD_LIBRARY_PATH": str(tmp_path)}).folders
    assert find_libraries((), SearchPaths(names=("libgts.so",), folders=())) == ()


def test_search_paths_on_windows() -> None:
    entries = os.pathsep.join(["/gts/bin", '"/quoted"', ".", ""])
    search = search_paths("win32", {"PATH": entries, "LD_LIBRARY_PATH": "/no"})
    assert search == SearchPaths(names=("gus.dll", "gts.dll"), folders=("/gts/bin", "/quoted"))


@needs_controller
def test_the_profiles_library_is_tried(made: Made, tmp_path: Path) -> None:
    path = Path(shutil.copy(made(GUS), tmp_path))
    profile = tmp_path / "gusjob.toml"
    profile.write_text(f"[controller]\nlibrary = '{path.name}'\n", encoding="utf-8")
    inside = run()
    assert f"  {path}: gus\n" in inside.output
    assert "in gusjob.toml" not in inside.output
    assert "in gusjob.toml, [controller]: library" in run("--library", made(GTS)).output
    other = profile.rename(tmp_path / "other.toml")
    assert str(path) not in run().output
    assert f"  {path}: gus\n" in run("--machine", other).output


def test_a_profile_with_errors_does_not_prevent_the_search(tmp_path: Path) -> None:
    (tmp_path / "gusjob.toml").write_text("nonsense = 1\n", encoding="utf-8")
    wrong = run("--format", "json")
    assert (wrong.exit_code, "nonsense" in wrong.stderr) == (1, True)
    assert json.loads(wrong.stdout)["schema"] == "gusjob-devices/1"
    assert run("--machine", tmp_path / "none.toml").exit_code == 2


# USB.


@dataclass
class Fake:
    """A USB device: its texts by index, and what opening it raises."""

    vendor: int = 0x9588
    product: int = 0x9899
    texts: dict[int, bytes] = field(default_factory=dict)
    error: Exception | None = None
    kernel_driver: bool | Exception = False
    opened: int = 0


def usb_error(code: int) -> Exception:
    error: Exception = import_module("usb.core").USBError("refused \x1b[31m", None, code)
    return error


class Bus:
    """A backend of pyusb with fake devices. It has only what reads: any other call is an AttributeError."""

    def __init__(self, *fakes: Fake) -> None:
        self.fakes = fakes

    def enumerate_devices(self) -> Sequence[Fake]:
        return self.fakes

    def get_device_descriptor(self, fake: Fake) -> SimpleNamespace:
        names = "bLength bDescriptorType bcdUSB bDeviceClass bDeviceSubClass bDeviceProtocol bMaxPacketSize0 bcdDevice"
        return SimpleNamespace(
            **dict.fromkeys(names.split(), 0), idVendor=fake.vendor, idProduct=fake.product, iManufacturer=0,
            iProduct=2 if 2 in fake.texts else 0, iSerialNumber=3 if 3 in fake.texts else 0, bNumConfigurations=1,
            bus=1, address=6, port_number=None, port_numbers=None, speed=None,
        )  # fmt: skip

    def open_device(self, fake: Fake) -> Fake:
        if fake.error is not None:
            raise fake.error
        assert not any(other.opened for other in self.fakes), "one at a time"
        fake.opened += 1
        return fake

    def close_device(self, fake: Fake) -> None:
        fake.opened -= 1

    def ctrl_transfer(
        self, fake: Fake, kind: int, request: int, value: int, _index: int, buffer: array.array[int], _timeout: int
    ) -> int:
        assert (kind, request, value >> 8) == (0x80, 6, 3), "nothing but texts is read"
        text = b"\x09\x04" if value & 0xFF == 0 else fake.texts[value & 0xFF]
        sent = bytes([2 + len(text), 3]) + text
        buffer[: len(sent)] = array.array("B", sent)
        return len(sent)

    def is_kernel_driver_active(self, fake: Fake, interface: int) -> bool:
        assert interface == 0
        if isinstance(fake.kernel_driver, Exception):
            raise fake.kernel_driver
        return fake.kernel_driver


def plug(monkeypatch: pytest.MonkeyPatch, *fakes: Fake) -> None:
    monkeypatch.setattr(usb, "usb_backend", lambda: Bus(*fakes))


def text(said: str) -> bytes:
    return said.encode("utf-16-le")


def test_known_devices_are_listed_with_their_texts(monkeypatch: pytest.MonkeyPatch) -> None:
    card = Fake(texts={2: text("USBLMCV4"), 3: text("A1\0")}, kernel_driver=True)
    plug(monkeypatch, Fake(vendor=0x1D6B, product=2), card, Fake(texts={3: text("B2")}))
    ((device, _), problem) = find_usb_devices()
    assert (device.known.ids, device.bus, device.address, problem) == ("9588:9899", 1, 6, None)
    assert (device.product, device.serial, device.kernel_driver, device.problem) == ("USBLMCV4", "A1", True, None)
    assert card.opened == 0, "it is closed again"
    out = run().output
    assert "9588:9899 BJJCZ (LMC) galvo card: gusjob can't drive it yet; EzCad2, LightBurn, MeerK40t can\n" in out
    assert "      USBLMCV4, serial A1, bus 1, address 6, in use by a driver of the system\n" in out


@pytest.mark.parametrize(("vendor", "product"), [(0x1A86, 0x5512), (0x0403, 0x6001), (0x0471, 0x0999)])
def test_general_chips_only_may_be_controllers(monkeypatch: pytest.MonkeyPatch, vendor: int, product: int) -> None:
    plug(monkeypatch, Fake(vendor=vendor, product=product))
    ((device,), _) = find_usb_devices()
    assert not device.known.sure
    assert f"{vendor:04x}:{product:04x}" in run().output
    assert "may be a" in device.known.name


def test_texts_of_devices_are_harmless(monkeypatch: pytest.MonkeyPatch) -> None:
    nasty = "\x1b]0;owned\x07\u202e12\n3"
    plug(monkeypatch, Fake(texts={2: text("a\x9bb"), 3: text(nasty)}))
    for out in (run().output, run("--format", "json").output):
        assert all(c.isprintable() or c == "\n" for c in out)
        assert "�]0;owned��12�3" in out
    assert "12\n3" not in run().output


def test_texts_that_are_no_texts(monkeypatch: pytest.MonkeyPatch) -> None:
    plug(monkeypatch, Fake(texts={2: b"\x00\xd8", 3: b""}))
    ((device,), _) = find_usb_devices()
    assert (device.product, device.serial, device.problem) == ("", "", None)


@pytest.mark.parametrize(
    ("error", "platform", "kind", "step"),
    [
        (
            usb_error(errno.EACCES),
            "linux",
            UsbProblemKind.PERMISSION,
            'ATTR{idVendor}=="9588", ATTR{idProduct}=="9899"',
        ),
        (usb_error(errno.EACCES), "win32", UsbProblemKind.BUSY, "close the program"),
        (usb_error(errno.EBUSY), "linux", UsbProblemKind.BUSY, "close the program"),
        (usb_error(errno.ENODEV), "linux", UsbProblemKind.GONE, "plug it in"),
        (usb_error(errno.ENOENT), "win32", UsbProblemKind.DRIVER, "Zadig"),
        (NotImplementedError("Operation not supported"), "win32", UsbProblemKind.DRIVER, "WinUSB"),
        (usb_error(errno.EIO), "linux", UsbProblemKind.OTHER, "plug it in"),
    ],
)
def test_why_a_device_cannot_be_read(
    monkeypatch: pytest.MonkeyPatch, error: Exception, platform: str, kind: UsbProblemKind, step: str
) -> None:
    plug(monkeypatch, Fake(texts={3: text("A1")}, error=error), Fake(texts={3: text("B2")}))
    ((shut, other), problem) = find_usb_devices(platform)
    assert problem is None
    assert (other.serial, other.problem) == ("B2", None)
    assert shut.problem is not None
    assert (shut.problem.kind, shut.serial) == (kind, "")
    assert step in " ".join(shut.problem.next_steps)
    assert "\x1b" not in shut.problem.reason


@pytest.mark.parametrize("error", [NotImplementedError("no"), usb_error(errno.ENOENT)])
def test_an_unknown_driver_is_no_problem(monkeypatch: pytest.MonkeyPatch, error: Exception) -> None:
    plug(monkeypatch, Fake(texts={3: text("A1")}, kernel_driver=error))
    ((device,), _) = find_usb_devices()
    assert (device.serial, device.kernel_driver, device.problem) == ("A1", None, None)


@pytest.mark.parametrize(
    ("platform", "step"), [("linux", "libusb-1.0-0"), ("win32", "pip install libusb-package"), ("darwin", "brew")]
)
def test_without_libusb(monkeypatch: pytest.MonkeyPatch, platform: str, step: str) -> None:
    for name in ("libusb0", "libusb1", "openusb"):
        monkeypatch.setattr(import_module(f"usb.backend.{name}"), "get_backend", lambda: None)
    monkeypatch.setitem(sys.modules, "libusb_package", None)
    monkeypatch.setattr(usb, "usb_backend", REAL_BACKEND)
    found, problem = find_usb_devices(platform)
    assert found == ()
    assert problem is not None
    assert (problem.kind, problem.reason) == (UsbProblemKind.NO_BACKEND, "libusb was not found")
    assert step in problem.next_steps[0]


def test_the_package_replaces_the_systems_libusb(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = Bus()
    monkeypatch.setattr(import_module("usb.backend.libusb1"), "get_backend", lambda: None)
    monkeypatch.setitem(sys.modules, "libusb_package", SimpleNamespace(get_libusb1_backend=lambda: bus))
    assert REAL_BACKEND() is bus


def test_usb_that_cannot_be_listed(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken(Bus):
        def enumerate_devices(self) -> Sequence[Fake]:
            raise usb_error(errno.EIO)

    monkeypatch.setattr(usb, "usb_backend", Broken)
    assert "  can't be read: " in run().output
    assert data()["usb_problem"]["kind"] == "other"


# The command.


def test_nothing_found_is_no_error() -> None:
    result = run()
    assert result.exit_code == 0
    flat = " ".join(result.output.split())
    assert "no library that fits; searched for libgus.so and libgts.so in no folder" in flat
    assert "no known laser controller; searched for 9588:9899 BJJCZ (LMC) galvo card," in flat
    assert "a Googol GUS or GTS is found only by its library: its USB ids are not public" in flat
    assert "No controller was opened, no device was changed." in flat


def test_json_form(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    plug(monkeypatch, Fake(texts={2: text("USBLMCV2")}, error=usb_error(errno.EBUSY)))
    assert data("--library", "x/libgts.so") == {
        "schema": "gusjob-devices/1",
        "python_bits": BITS,
        "platform": sys.platform,
        "searched": {"names": ["libgus.so", "libgts.so"], "folders": []},
        "libraries": [
            {
                "path": "x/libgts.so", "loaded": False, "reason": "there is no such file", "abis": [], "missing": {},
                "next_steps": ["name the library's file with --library, or write its path into gusjob.toml"],
            }
        ],
        "usb": [
            {
                "id": "9588:9899", "name": "BJJCZ (LMC) galvo card", "sure": True, "gusjob_drives": False,
                "driven_by": "EzCad2, LightBurn, MeerK40t", "product": "", "serial": "", "bus": 1, "address": 6,
                "kernel_driver": None,
                "problem": {
                    "kind": "busy", "reason": "another program has it open",
                    "next_steps": ["close the program that drives the laser"],
                },
            }
        ],
        "usb_problem": None,
    }  # fmt: skip


@needs_controller
def test_json_of_a_library(made: Made) -> None:
    path = made(GTS)
    assert data("--library", path)["libraries"] == [
        {
            "path": str(path), "loaded": True, "reason": "", "abis": ["gts", "gts-multi"],
            "missing": {"gus": [FOLLOW]}, "next_steps": [],
        }
    ]  # fmt: skip
    assert f"{path}: gts or gts-multi: only opening the controller shows which" in run("--library", path).output
