"""The name of a listing that no file can have."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from gusjob.record.recording import RecordOptions, refusal


@pytest.mark.skipif(sys.platform == "win32", reason="limits and links of POSIX")
def test_an_output_that_can_not_be_named(tmp_path: Path) -> None:
    for output in (tmp_path / ("x" * 5000), tmp_path / "none" / "a.gts"):
        reason = refusal(RecordOptions(command=("true",), output=output))
        assert reason is not None
        assert "can't write" in reason
