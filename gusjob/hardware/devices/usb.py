"""Known laser controllers on USB, and why USB or a device can't be read."""

from __future__ import annotations

import errno
import sys
from collections.abc import Mapping
from enum import StrEnum
from importlib import import_module
from typing import Any

from msgspec import Struct

from gusjob.i18n.phrases import Phrase, printable


class KnownUsb(Struct, frozen=True, kw_only=True):
    """A laser controller with its USB ids.

    `sure`: False if other products have the same ids; `driven_by`: programs that drive it; `gusjob`: whether gusjob can
    drive it; `short`: the name without the possible boards.
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
        """The ids as lsusb shows them."""
        return f"{self.vendor:04x}:{self.product:04x}"


KNOWN_USB = (
    # No Googol GUS or GTS: none of their ids is public.
    # 9588:9899 as in Balor, galvoplotter and MeerK40t (balormk); 9880 until the driver has loaded the card's firmware.
    KnownUsb(
        vendor=0x9588, product=0x9899, name=Phrase("BJJCZ (LMC) galvo card"), driven_by="EzCad2, LightBurn, MeerK40t"
    ),
    KnownUsb(
        vendor=0x9588,
        product=0x9880,
        name=Phrase("BJJCZ (LMC) galvo card without its firmware, which its driver loads"),
        driven_by="EzCad2, LightBurn",
    ),
    # As in K40 Whisperer and MeerK40t (lihuiyu, moshi).
    KnownUsb(
        vendor=0x1A86,
        product=0x5512,
        name=Phrase("CH341 chip: may be a Lihuiyu M2/M3 Nano or a Moshi board"),
        sure=False,
        driven_by="K40 Whisperer, MeerK40t",
        short=Phrase("CH341 chip"),
    ),
    # As in the public notes on RDLxxx controllers (FT245R).
    KnownUsb(
        vendor=0x0403,
        product=0x6001,
        name=Phrase("FTDI serial chip: may be a Ruida controller"),
        sure=False,
        driven_by="RDWorks, LightBurn",
        short=Phrase("FTDI serial chip"),
    ),
    # As in MeerK40t (newly).
    KnownUsb(
        vendor=0x0471,
        product=0x0999,
        name=Phrase("may be a Newly board (NewlyDraw)"),
        sure=False,
        driven_by="NewlyDraw, MeerK40t",
    ),
)
"""Laser controllers whose USB ids are public."""


class UsbProblemKind(StrEnum):
    """What prevents reading USB."""

    NO_BACKEND = "no-backend"
    PERMISSION = "permission"
    DRIVER = "driver"
    BUSY = "busy"
    GONE = "gone"
    OTHER = "other"


class UsbProblem(Struct, frozen=True, kw_only=True):
    """Why USB or one device can't be read, and what to do."""

    kind: UsbProblemKind
    reason: str
    next_steps: tuple[str, ...] = ()


class UsbDevice(Struct, frozen=True, kw_only=True):
    """A device with known ids.

    `serial`, `product`: '' if it has no such text, or if the text can't be read, which is a `problem` then;
    `kernel_driver`: whether a driver of the system holds its first interface, None if unknown.
    """

    known: KnownUsb
    bus: int | None
    address: int | None
    serial: str = ""
    product: str = ""
    kernel_driver: bool | None = None
    problem: UsbProblem | None = None


def find_usb_devices(platform: str = sys.platform) -> tuple[tuple[UsbDevice, ...], UsbProblem | None]:
    """Find the known laser controllers on USB. Reading changes nothing on a device.

    Returns:
        The devices, and the problem that prevented the search, or None.
    """
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
    """Return what pyusb raises: its own, and NotImplementedError for what libusb can't do on this system (Windows)."""
    return import_module("usb.core").USBError, NotImplementedError


def usb_backend() -> Any:
    """Return the system's libusb, or that of the package libusb-package if the system has none (Windows)."""
    backend = import_module("usb.backend.libusb1").get_backend()
    if backend is not None:
        return backend
    try:
        return import_module("libusb_package").get_libusb1_backend()
    except ImportError:
        return None  # pyusb tries older libraries then.


def _read(device: Any, known: KnownUsb, platform: str) -> UsbDevice:
    """Read a device's descriptors; nothing is claimed, configured or reset."""
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
        known=known,
        bus=device.bus,
        address=device.address,
        serial=texts[0],
        product=texts[1],
        kernel_driver=driver,
        problem=problem,
    )


def _text(device: Any, index: int, language: int) -> str:
    """Return a text of a device, safe for a terminal; '' if there is none or it is no text."""
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
    UsbProblemKind.GONE: Phrase("it was unplugged in the meantime"),
    UsbProblemKind.DRIVER: Phrase("its driver does not let libusb open it"),
}

_NO_BACKEND = Phrase("libusb was not found")
_NO_BACKEND_STEPS: Mapping[str, tuple[str, ...]] = {
    "win32": ("pip install libusb-package",),
    "darwin": (Phrase("brew install libusb, or: pip install libusb-package"),),
    "linux": (Phrase("sudo apt install libusb-1.0-0 (elsewhere the package is called libusb or libusb1)"),),
}


def _usb_problem(error: Exception, known: KnownUsb | None, platform: str) -> UsbProblem:
    """Explain an error of pyusb; an operation that libusb does not support is a matter of the driver."""
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
            # 73-seat-late.rules evaluates uaccess: the file's number must be lower.
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
                    "keep this driver for the manufacturer's program; MeerK40t and others that use libusb need WinUSB "
                    "instead (Zadig, https://zadig.akeo.ie), with which the manufacturer's program no longer works"
                ),
            )
        case UsbProblemKind.GONE | UsbProblemKind.OTHER:
            return (Phrase("plug it in again, without a hub"),)
        case _:
            return ()
