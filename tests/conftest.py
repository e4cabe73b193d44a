"""One flag for all that is generated: `pytest --rewrite` writes goldens and tables anew; the diff is to be read."""

from __future__ import annotations

import os
import signal

import pytest
from hypothesis import settings

# Texts are compared in English, whatever the system speaks; test_chinese.py asks for what it wants.
os.environ["LANGUAGE"] = "en"

# CI tries the same examples each time; by hand every run tries new ones. No test is to fail on a busy machine.
settings.register_profile("new", deadline=None)
settings.register_profile("fixed", deadline=None, derandomize=True)
settings.load_profile("fixed" if os.environ.get("CI") else "new")


def pytest_collection_finish() -> None:
    """vcdvcd, which reads VCD for us, lets a closed pipe end the process that imports it; Python does not."""
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)


def pytest_addoption(parser: pytest.Parser) -> None:
    """The flag."""
    parser.addoption("--rewrite", action="store_true", help="write goldens and generated tables anew")


@pytest.fixture
def rewrite(request: pytest.FixtureRequest) -> bool:
    """Whether to write instead of to compare."""
    return bool(request.config.getoption("--rewrite"))
