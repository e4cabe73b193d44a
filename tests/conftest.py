"""Settings for all tests: the language, hypothesis, processes in parallel, marks, and the flag --rewrite."""

from __future__ import annotations

import os
import signal
import sys

import pytest
from hypothesis import settings
from support.controller import needs_controller

# Texts are compared in English, whatever the system's language; tests of Chinese set their own.
os.environ["LANGUAGE"] = "en"
# Commands that tests start write through a buffer, as they do for users.
os.environ.pop("PYTHONUNBUFFERED", None)

# CI tries the same examples each time; by hand every run tries new ones. No test fails because the machine is busy.
settings.register_profile("new", deadline=None)
settings.register_profile("fixed", deadline=None, derandomize=True)
settings.load_profile("fixed" if os.environ.get("CI") else "new")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add --rewrite."""
    parser.addoption("--rewrite", action="store_true", help="write golden files and generated tables again")


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Run the whole suite in parallel, unless -n says otherwise; some files, or --rewrite, in one process.

    One process more than cores: the tests of the browser and of the virtual controller wait for much of their time.
    """
    is_worker = hasattr(config, "workerinput")
    if is_worker or config.args_source is not pytest.Config.ArgsSource.TESTPATHS or config.getoption("rewrite"):
        return
    # Without pytest-xdist (-p no:xdist) there is no such option.
    if config.getoption("numprocesses", 0) is None:
        cores = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
        config.option.numprocesses = min(cores, 15) + 1
        # A worker keeps the tests of a module, and what they share, as long as it has work of its own.
        config.option.dist = "worksteal"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what needs the virtual controller, and run what takes long first, so that no process waits at the end."""
    for item in items:
        if needs_controller.mark in item.iter_markers("skipif"):
            item.add_marker("hardware")
    first = {item.module for item in items if isinstance(item, pytest.Function) and item.get_closest_marker("slow")}
    items.sort(key=lambda item: getattr(item, "module", None) not in first)


def pytest_collection_finish() -> None:
    """Ignore SIGPIPE again, as Python does: vcdvcd, which reads VCD for the tests, sets it to end the process."""
    if hasattr(signal, "SIGPIPE"):
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)


@pytest.fixture
def rewrite(request: pytest.FixtureRequest) -> bool:
    """Whether to write files instead of comparing them."""
    return bool(request.config.getoption("--rewrite"))
