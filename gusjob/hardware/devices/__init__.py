"""Devices of this computer: the vendor's libraries, and USB devices that are known laser controllers.

Nothing is changed: a library is loaded but none of its calls is made (not even GT_Open), and only texts are read from a
USB device. A Googol controller is found by its library alone: none of its USB ids is public.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable

from msgspec import Struct

from gusjob.controllers.gus.driver.inspection import VendorLibrary
from gusjob.controllers.gus.driver.library import BITS
from gusjob.hardware.devices.libraries import SearchPaths, find_libraries, search_paths
from gusjob.hardware.devices.usb import UsbDevice, UsbProblem, find_usb_devices


class Survey(Struct, frozen=True, kw_only=True):
    """All that was found, and where it was searched for."""

    search: SearchPaths
    libraries: tuple[VendorLibrary, ...]
    usb: tuple[UsbDevice, ...]
    usb_problem: UsbProblem | None
    platform: str = sys.platform
    python_bits: int = BITS


def survey(named: Iterable[str], search: SearchPaths | None = None) -> Survey:
    """Find what this computer can run on.

    Args:
        named: libraries that the user or the machine profile names.
        search: where to search for others; None for this computer's folders.
    """
    search = search or search_paths()
    libraries = find_libraries(tuple(named), search)
    usb, problem = find_usb_devices()
    return Survey(search=search, libraries=libraries, usb=usb, usb_problem=problem)
