"""A browser for tests: chromium through playwright, with all that it complains of and that it asks a network for."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

_NAMES = ("chromium", "chromium-browser", "google-chrome")
_ARGUMENTS = [
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update",
    "--disable-sync", "--no-first-run",
]  # fmt: skip
READY_MS = 60_000
"""A page of a million segments is read in seconds; a loaded machine takes its time."""


def rest(page: Page, ms: int) -> None:
    """Wait by the page's own clock, and for what it draws then: its timers come in order, however busy the machine."""
    page.evaluate(
        """(ms) => new Promise((done) => setTimeout(() => requestAnimationFrame(() => requestAnimationFrame(
        () => setTimeout(done, 0))), ms))""",
        ms,
    )


@dataclass(frozen=True, slots=True)
class Tab:
    """A page in the browser. `complaints`: errors and warnings of its console and scripts; `requests`: other files."""

    page: Page
    complaints: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)

    def ready(self) -> Tab:
        """Wait until all views are drawn."""
        self.page.wait_for_selector("html[data-ready]", timeout=READY_MS, state="attached")
        self.drawn()
        return self

    def drawn(self) -> None:
        """Wait until the path's tiles are drawn."""
        self.page.wait_for_function(
            "() => gusjob.path.isIdle() && !document.querySelector('.leaflet-zoom-anim, .leaflet-pan-anim')",
            timeout=READY_MS,
        )
        rest(self.page, 150)


@dataclass(frozen=True, slots=True)
class Chromium:
    """The running browser."""

    browser: Browser

    @contextmanager
    def open(
        self,
        path: Path | str,
        *,
        fragment: str = "",
        width: int = 1280,
        height: int = 900,
        dark: bool = False,
        scripts: bool = True,
        before: str = "",
        ratio: float = 1.0,
    ) -> Iterator[Tab]:
        """A file, or an address, in a window of its own; `before`: a script that runs first."""
        scheme: Literal["dark", "light"] = "dark" if dark else "light"
        context = self.browser.new_context(
            viewport={"width": width, "height": height},
            color_scheme=scheme,
            java_script_enabled=scripts,
            accept_downloads=True,
            device_scale_factor=ratio,
        )
        try:
            page = context.new_page()
            tab = Tab(page)
            if before:
                page.add_init_script(before)
            address = path if isinstance(path, str) else path.resolve().as_uri()
            page.on("console", lambda m: tab.complaints.append(m.text) if m.type in ("error", "warning") else None)
            page.on("pageerror", lambda diagnostic: tab.complaints.append(str(diagnostic)))
            page.on(
                "request",
                lambda r: (
                    None
                    if r.url.split("#")[0] == address or r.url.startswith(("data:", "blob:"))
                    else tab.requests.append(r.url)
                ),
            )
            page.goto(address + fragment)
            yield tab
        finally:
            context.close()


@pytest.fixture(scope="module")
def chromium() -> Iterator[Chromium]:
    """One browser for all tests; without one they are skipped."""
    api = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    found = next(filter(None, map(shutil.which, _NAMES)), None)
    if found is None:
        pytest.skip("no browser: none of " + ", ".join(_NAMES))
    with api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=_ARGUMENTS)
        yield Chromium(browser)
        browser.close()
