"""Libraries whose name is no UTF-8, too long or not that of a file: the reason is shown."""

from __future__ import annotations

import os
import shutil
import sys
from pathlib import Path

import pytest

from gusjob.controllers.gus.driver.library import has_symbol, open_library

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes only there")


@pytest.mark.parametrize("name", [b"none\xff\xfe.so", b"x" * 5000, b"a\nb.so", "层".encode("gb18030")])
def test_a_library_that_is_not_there(name: bytes, tmp_path: Path) -> None:
    for path in (os.fsdecode(name), str(tmp_path / os.fsdecode(name))):
        reason = open_library(path)
        assert isinstance(reason, str)
        assert reason.isprintable()
        reason.encode()


def test_a_damaged_library_with_a_name_of_bytes(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"lib\xff.so")
    path.write_bytes(b"\x7fELF and nothing more")
    assert isinstance(open_library(str(path)), str)


def test_a_library_with_a_name_of_bytes_has_no_such_symbol(tmp_path: Path) -> None:
    found = next((p for p in Path("/proc/self/maps").read_text().split() if "/libm" in p or "/libc" in p), None)
    assert found is not None
    path = tmp_path / os.fsdecode(b"lib\xff.so")
    shutil.copy(found, path)
    handle = open_library(str(path))
    assert not isinstance(handle, str)
    assert not has_symbol(handle, "GT_Open")
