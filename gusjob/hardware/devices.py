"""What this computer could run on: the vendor's libraries, and USB devices that are known laser controllers.

Nothing is touched: a library is loaded but none of its calls is made (GT_Open neither), of a USB device only texts
are read. A Googol controller is found by its library alone: no USB id of one is public.
"""

from __future__ import annotations

import ctypes.util
import errno
import os
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from importlib import import_module
from pathlib import Path
from typing import Any

from gusjob.config.machine import Abi
from gusjob.controllers.gus.driver.abi import ABI_PROFILES, prototypes
from gusjob.controllers.gus.driver.library import BITS, NOT_FOUND, has_symbol, open_library, other_family
from gusjob.controllers.gus.driver.requirements import RUN_CALLS
from gusjob.i18n.phrases import Phrase, printable

# Vendor libraries.

LIBRARY_NAMES: Mapping[str, tuple[str, ...]] = {
    "win32": ("gus.dll", "gts.dll"),  # Case does not count there: GUS.dll is the same.
    "darwin": ("libgus.dylib", "libgts.dylib"),  # As far as is known the vendor has none.
    "linux": ("libgus.so", "libgts.so"),
}
"""What the vendor's libraries are called, by sys.platform; other systems are taken for Linux."""

_PATH_VARIABLE = {"win32": "PATH", "darwin": "DYLD_LIBRARY_PATH"}
_SYSTEM_FOLDERS = ("/usr/lib", "/usr/local/lib", "/usr/lib64")

LASER_CALLS = ("GT_LaserPowerMode", "GT_BufLaserOn", "GT_BufLaserOff", "GT_BufLaserPrfCmd")
"""What every laser job needs, beside the calls of every run."""

_CALLS = (*RUN_CALLS, *LASER_CALLS)


@dataclass(frozen=True, slots=True, kw_only=True)
class SearchPaths:
    """Where libraries are looked for. `system`: also where the system's loader looks."""

    names: tuple[str, ...]
    folders: tuple[str, ...]
    system: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class VendorLibrary:
    """A library that was found or named. `abis`: those that it fits; `missing`: symbols that others lack only few of.

    `reason`: why it can't be loaded, or fits none; `next_steps`: what to do about that.
    """

    path: str
    loaded: bool
    reason: str = ""
    abis: tuple[Abi, ...] = ()
    missing: Mapping[Abi, tuple[str, ...]] = field(default_factory=dict)
    next_steps: tuple[str, ...] = ()


def search_paths(platform: str = sys.platform, environ: Mapping[str, str] = os.environ) -> SearchPaths:
    """Where to look on this computer.

    Never in the current folder, nor in a part of PATH that means it: loading a library runs its code, and who sends a
    job could send a library beside it.
    """
    entries = environ.get(_PATH_VARIABLE.get(platform, "LD_LIBRARY_PATH"), "").split(os.pathsep)
    entries = [entry.strip('"') for entry in entries] if platform == "win32" else entries
    folders = [entry for entry in entries if Path(entry).is_absolute()]
    # The loader goes by the same list: one that leads to the current folder keeps us from asking it.
    system = platform != "win32" and (entries == [""] or len(folders) == len(entries))
    if platform != "win32":
        folders += [*_SYSTEM_FOLDERS, *sorted(str(path) for path in Path("/usr/lib").glob("*-linux-gnu*"))]
    names = LIBRARY_NAMES.get(platform, LIBRARY_NAMES["linux"])
    return SearchPaths(names=names, folders=tuple(dict.fromkeys(folders)), system=system)


def vendor_libraries(named: Sequence[str], search: SearchPaths) -> tuple[VendorLibrary, ...]:
    """The libraries that the user names, there or not, and those that are found elsewhere; each once."""
    paths = [*map(_from_here, named), *_in_folders(search), *_by_loader(search)]
    once = {_identity(path): path for path in reversed(paths)}
    return tuple(inspect_library(path) for path in paths if once.get(_identity(path)) is path)


def _from_here(path: str) -> str:
    """A file from the current folder, which the user may name, by its whole path; else as it is."""
    return str(Path(path).absolute()) if _there(path) else path


def _in_folders(search: SearchPaths) -> list[str]:
    paths = (str(Path(folder) / name) for folder in search.folders for name in search.names)
    return [path for path in paths if _there(path) and not Path(path).is_dir()]


def _by_loader(search: SearchPaths) -> list[str]:
    """Bare names under which the system's loader knows a library that lies in none of the folders."""
    if not search.system:
        return []
    known = {name for path in _in_folders(search) for name in (Path(path).name, Path(path).resolve().name)}
    stems = (name.removeprefix("lib").partition(".")[0] for name in search.names)
    found = (ctypes.util.find_library(stem) for stem in stems)
    return [name for name in found if name and Path(name).name not in known]


def _identity(path: str) -> str:
    return os.path.normcase(os.path.realpath(path)) if _there(path) else path


def _there(path: str) -> bool:
    try:
        return bool(path) and Path(path).exists()
    except (OSError, ValueError):  # A folder that may not be looked into; a character that no path can have.
        return False


def inspect_library(path: str) -> VendorLibrary:
    """Loads a library (a path, or a bare name for the system's search) and sees which ABIs it fits. Makes no call."""
    shown = printable(path)
    handle: Any = open_library(path)
    if isinstance(handle, str):
        reason = handle if isinstance(handle, Phrase) else handle.removeprefix(f"{shown}: ")
        return VendorLibrary(path=shown, loaded=False, reason=reason, next_steps=_library_steps(reason))
    missing = {abi: _missing(handle, abi) for abi in Abi}
    abis = tuple(abi for abi in Abi if not missing[abi])
    near = {abi: symbols for abi, symbols in missing.items() if symbols and len(symbols) <= len(_CALLS) // 2}
    if abis:
        return VendorLibrary(path=shown, loaded=True, abis=abis, missing=near)
    return _unfitting(shown, near)


def _unfitting(shown: str, near: Mapping[Abi, tuple[str, ...]]) -> VendorLibrary:
    """A library that fits none; `near`: symbols that it lacks for an ABI, where those are few."""
    if near:
        reason = Phrase("calls are missing that every laser job needs")
        step = Phrase("ask the vendor for the library with laser calls")
    else:
        reason = Phrase("it has not the calls of a Googol library")
        step = Phrase("name another one with --library")
    return VendorLibrary(path=shown, loaded=True, reason=reason, missing=near, next_steps=(step,))


def _missing(handle: Any, abi: Abi) -> tuple[str, ...]:
    """The symbols that a library lacks for an ABI; the other family's lacks the one by which it is told."""
    known = prototypes(abi, 0)
    missing = tuple(known[name].symbol for name in _CALLS if not has_symbol(handle, known[name].symbol))
    return (*missing, ABI_PROFILES[abi].own_symbol) if other_family(handle, abi) else missing


_LIBRARY_STEPS: tuple[tuple[tuple[str, ...], str], ...] = (
    ((NOT_FOUND,), Phrase("name the library's file with --library, or write its path into gusjob.toml")),
    (("a folder",), Phrase("name the library in it with --library")),
    (
        ("which has", "WinError 193"),
        Phrase(
            "the library must have this Python's {bits} bits: get that one from the vendor, or install gusjob with a "
            "Python of {others} bits",
            bits=BITS,
            others=96 - BITS,
        ),
    ),
    (
        ("Permission denied", "WinError 5]", "Operation not permitted", "failed to map segment"),
        Phrase("let your user read it and run what is in it (Linux: chmod a+rx FILE; not on a disk mounted noexec)"),
    ),
    (
        ("one of its dependencies", "WinError 126", "WinError 127"),
        Phrase(
            "install the vendor's driver package, which holds what this library needs, or put the vendor's other DLLs "
            "into its folder"
        ),
    ),
    (
        ("cannot open shared object", "undefined symbol", "image not found", "Library not loaded"),
        Phrase("install what the library needs: `ldd FILE` (macOS: `otool -L FILE`) shows it"),
    ),
    (
        ("cut short", "invalid ELF header", "file too short", "not a mach-o file", "slice is not valid"),
        Phrase("copy it again from the vendor's package, the one for this system"),
    ),
)
"""What to do, by parts of the reason; the first that fits."""


def _library_steps(reason: str) -> tuple[str, ...]:
    found = (step for parts, step in _LIBRARY_STEPS if any(part in reason for part in parts))
    return tuple(found)[:1]


# USB devices.


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownUsb:
    """A laser controller by its USB ids. `sure`: False where other things have the same ids.

    `driven_by`: programs that drive it; `gusjob`: whether gusjob can; `short`: the name without what it may be.
    """

    vendor: int
    product: int
    name: str
    driven_by: str
    sure: bool = True
    gusjob: bool = False
    short: str = ""

    @property
    def ids(self) -> str:
        """As lsusb shows them."""
        return f"{self.vendor:04x}:{self.product:04x}"


KNOWN_USB = (
    # No Googol GUS or GTS among them: none of their ids is public.
    # 9588:9899 as in Balor, galvoplotter and MeerK40t (balormk); 9880 until the driver has loaded the card's firmware.
    KnownUsb(
        vendor=0x9588, product=0x9899, name=Phrase("BJJCZ (LMC) galvo card"), driven_by="EzCad2, LightBurn, MeerK40t"
    ),
    KnownUsb(
        vendor=0x9588, product=0x9880,
        name=Phrase("BJJCZ (LMC) galvo card without its firmware, which its driver loads"),
        driven_by="EzCad2, LightBurn",
    ),
    # As in K40 Whisperer and MeerK40t (lihuiyu, moshi).
    KnownUsb(
        vendor=0x1A86, product=0x5512, name=Phrase("CH341 chip: may be a Lihuiyu M2/M3 Nano or a Moshi board"),
        sure=False, driven_by="K40 Whisperer, MeerK40t", short=Phrase("CH341 chip"),
    ),
    # As in the public notes on RDLxxx controllers (FT245R).
    KnownUsb(
        vendor=0x0403, product=0x6001, name=Phrase("FTDI serial chip: may be a Ruida controller"), sure=False,
        driven_by="RDWorks, LightBurn", short=Phrase("FTDI serial chip"),
    ),
    # As in MeerK40t (newly).
    KnownUsb(
        vendor=0x0471, product=0x0999, name=Phrase("may be a Newly board (NewlyDraw)"), sure=False,
        driven_by="NewlyDraw, MeerK40t",
    ),
)  # fmt: skip
"""Laser controllers whose USB ids are public."""


class UsbProblemKind(StrEnum):
    """What keeps us from reading USB."""

    NO_BACKEND = "no-backend"
    PERMISSION = "permission"
    DRIVER = "driver"
    BUSY = "busy"
    GONE = "gone"
    OTHER = "other"


@dataclass(frozen=True, slots=True, kw_only=True)
class UsbProblem:
    """Why USB, or one device, can't be read, and what to do."""

    kind: UsbProblemKind
    reason: str
    next_steps: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class UsbDevice:
    """A device with known ids. Texts are '' if it has none or they can't be read, which is a `problem` then.

    `kernel_driver`: whether a driver of the system holds its first interface; None: not known.
    """

    known: KnownUsb
    bus: int | None
    address: int | None
    serial: str = ""
    product: str = ""
    kernel_driver: bool | None = None
    problem: UsbProblem | None = None


def usb_devices(platform: str = sys.platform) -> tuple[tuple[UsbDevice, ...], UsbProblem | None]:
    """The known laser controllers on USB, and what kept us from looking. Reading changes nothing on a device."""
    core = import_module("usb.core")
    table = {(known.vendor, known.product): known for known in KNOWN_USB}
    try:
        every = list(core.find(find_all=True, backend=usb_backend()))
    except core.NoBackendError:
        steps = _NO_BACKEND_STEPS.get(platform, _NO_BACKEND_STEPS["linux"])
        return (), UsbProblem(kind=UsbProblemKind.NO_BACKEND, reason=_NO_BACKEND, next_steps=steps)
    except _usb_errors() as error:
        return (), _usb_problem(error, None, platform)
    found = ((table.get((device.idVendor, device.idProduct)), device) for device in every)
    return tuple(_read(device, known, platform) for known, device in found if known is not None), None


def _usb_errors() -> tuple[type[Exception], ...]:
    """What pyusb raises: its own, and NotImplementedError for what libusb can't do on this system (Windows)."""
    return import_module("usb.core").USBError, NotImplementedError


def usb_backend() -> Any:
    """The system's libusb, or that of the package libusb-package, for where the system has none (Windows)."""
    backend = import_module("usb.backend.libusb1").get_backend()
    if backend is not None:
        return backend
    try:
        return import_module("libusb_package").get_libusb1_backend()
    except ImportError:
        return None  # pyusb goes on to older libraries.


def _read(device: Any, known: KnownUsb, platform: str) -> UsbDevice:
    """A device with its texts: descriptors are asked for; nothing is claimed, configured or reset."""
    util = import_module("usb.util")
    texts, driver, problem = ["", ""], None, None
    try:
        if languages := util.get_langids(device):
            texts = [_text(device, index, languages[0]) for index in (device.iSerialNumber, device.iProduct)]
        driver = _kernel_driver(device)
    except _usb_errors() as error:
        problem = _usb_problem(error, known, platform)
    finally:
        util.dispose_resources(device)
    return UsbDevice(
        known=known, bus=device.bus, address=device.address, serial=texts[0], product=texts[1],
        kernel_driver=driver, problem=problem,
    )  # fmt: skip


def _text(device: Any, index: int, language: int) -> str:
    """A text of a device, harmless to a terminal; '' for none and for one that is no text."""
    try:
        text = import_module("usb.util").get_string(device, index, language)
    except ValueError:
        return ""
    return printable((text or "").strip("\0 "))


def _kernel_driver(device: Any) -> bool | None:
    try:
        return bool(device.is_kernel_driver_active(0))
    except _usb_errors():
        return None


_ERRORS = {
    errno.EACCES: UsbProblemKind.PERMISSION,
    errno.EPERM: UsbProblemKind.PERMISSION,
    errno.EBUSY: UsbProblemKind.BUSY,
    errno.ENODEV: UsbProblemKind.GONE,
    errno.ENOENT: UsbProblemKind.DRIVER,
    errno.ENOSYS: UsbProblemKind.DRIVER,
}

_REASONS = {
    UsbProblemKind.PERMISSION: Phrase("your user may not open it"),
    UsbProblemKind.BUSY: Phrase("another program has it open"),
    UsbProblemKind.GONE: Phrase("it was unplugged meanwhile"),
    UsbProblemKind.DRIVER: Phrase("its driver does not let libusb open it"),
}

_NO_BACKEND = Phrase("libusb was not found")
_NO_BACKEND_STEPS: Mapping[str, tuple[str, ...]] = {
    "win32": ("pip install libusb-package",),
    "darwin": (Phrase("brew install libusb, or: pip install libusb-package"),),
    "linux": (Phrase("sudo apt install libusb-1.0-0 (elsewhere the package is called libusb or libusb1)"),),
}


def _usb_problem(error: Exception, known: KnownUsb | None, platform: str) -> UsbProblem:
    """What an error of pyusb means; an operation that libusb does not support there is a matter of the driver."""
    code = errno.ENOSYS if isinstance(error, NotImplementedError) else getattr(error, "errno", None)
    kind = _ERRORS.get(code or 0, UsbProblemKind.OTHER)
    # Windows and macOS have no permissions for USB devices: they refuse what another program holds.
    if kind is UsbProblemKind.PERMISSION and platform in ("win32", "darwin"):
        kind = UsbProblemKind.BUSY
    reason = _REASONS.get(kind, printable(str(error)) or type(error).__name__)
    return UsbProblem(kind=kind, reason=reason, next_steps=_usb_steps(kind, known, platform))


def _usb_steps(kind: UsbProblemKind, known: KnownUsb | None, platform: str) -> tuple[str, ...]:
    match kind:
        case UsbProblemKind.PERMISSION if known is not None:
            # uaccess is given out by 73-seat-late.rules: the file's number must be lower.
            ids = f'ATTR{{idVendor}}=="{known.vendor:04x}", ATTR{{idProduct}}=="{known.product:04x}"'
            return (
                Phrase("write this line into /etc/udev/rules.d/70-laser.rules:"),
                f'SUBSYSTEM=="usb", {ids}, MODE="0660", TAG+="uaccess"',
                Phrase(
                    "then: sudo udevadm control --reload, and plug it in again; for a login over the network add "
                    'GROUP="YOUR-GROUP"'
                ),
            )
        case UsbProblemKind.BUSY:
            return (Phrase("close the program that drives the laser"),)
        case UsbProblemKind.DRIVER if platform == "win32":
            return (
                Phrase(
                    "leave it so for the maker's program; MeerK40t and others that go by libusb need WinUSB in its "
                    "place (Zadig, https://zadig.akeo.ie), with which the maker's program no longer works"
                ),
            )
        case UsbProblemKind.GONE | UsbProblemKind.OTHER:
            return (Phrase("plug it in again, without a hub"),)
        case _:
            return ()


# Both.


@dataclass(frozen=True, slots=True, kw_only=True)
class Survey:
    """All that was found, and where was looked."""

    search: SearchPaths
    libraries: tuple[VendorLibrary, ...]
    usb: tuple[UsbDevice, ...]
    usb_problem: UsbProblem | None
    platform: str = sys.platform
    python_bits: int = BITS


def survey(named: Iterable[str], search: SearchPaths | None = None) -> Survey:
    """What this computer could run on. `named`: libraries that the user or the machine profile names."""
    search = search or search_paths()
    libraries = vendor_libraries(tuple(named), search)
    usb, problem = usb_devices()
    return Survey(search=search, libraries=libraries, usb=usb, usb_problem=problem)
