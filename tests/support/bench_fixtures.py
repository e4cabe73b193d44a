"""Fixtures of tests on the virtual controller; a conftest imports them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from support.controller import GTS, GTS_MULTI, GUS
from support.hardware import Bench, bench, fresh

from gusjob.controllers.gus.driver import fifo, session


@pytest.fixture(scope="session")
def benches(tmp_path_factory: pytest.TempPathFactory) -> dict[int, Bench]:
    """A virtual controller of each ABI."""
    folder = tmp_path_factory.mktemp("controllers")
    return {abi: bench(folder, abi) for abi in (GUS, GTS, GTS_MULTI)}


@pytest.fixture
def gus(benches: dict[int, Bench], monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    """A GUS that was just switched on, polled often in real time and seldom in its own, so that tests are short."""
    monkeypatch.setattr(fifo, "POLL_S", 0.0005)
    monkeypatch.setattr(session, "_PAUSE_S", 0.002)
    made = benches[GUS]
    fresh(made)
    yield made
    made.controller.reset()
