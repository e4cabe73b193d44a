"""One flag for all that is generated: `pytest --rewrite` writes goldens and tables anew; the diff is to be read."""

from __future__ import annotations

import os

import pytest
from hypothesis import settings

# CI tries the same examples each time; by hand every run tries new ones.
settings.register_profile("fixed", derandomize=True)
if os.environ.get("CI"):
    settings.load_profile("fixed")


def pytest_addoption(parser: pytest.Parser) -> None:
    """The flag."""
    parser.addoption("--rewrite", action="store_true", help="write goldens and generated tables anew")


@pytest.fixture
def rewrite(request: pytest.FixtureRequest) -> bool:
    """Whether to write instead of to compare."""
    return bool(request.config.getoption("--rewrite"))
