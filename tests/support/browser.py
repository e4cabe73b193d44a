"""A browser for tests: Chromium through playwright. It records errors, warnings and network requests."""

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
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
]
READY_MS = 60_000
"""Timeout: a page of a million segments takes seconds, more on a busy machine."""


def rest(page: Page, ms: int) -> None:
    """Wait by the page's own clock, then for two frames: its timers run in order, however busy the machine is."""
    page.evaluate(
        """(ms) => new Promise((done) => setTimeout(() => requestAnimationFrame(() => requestAnimationFrame(
        () => setTimeout(done, 0))), ms))""",
        ms,
    )


_KEEP = """() => {
  window.kept = JSON.stringify([gusjob.path.state(), gusjob.time.state(), gusjob.table.state()]);
}"""
_RESET = """() => {
  const [path, time, table] = JSON.parse(window.kept);
  const byId = (id) => document.getElementById(id);
  gusjob.select(null, "hash");
  history.replaceState(null, "", location.pathname);
  gusjob.path.restore(path);
  gusjob.time.restore(time);
  gusjob.table.restore(table);
  if (byId("tab-marks")) gusjob.table.showTab(table.tab);
  for (const { api } of Object.values(gusjob.table.grids)) {
    api.setFilterModel(null);
    api.applyColumnState({ defaultState: { sort: null } });
    api.clearFocusedCell();
    api.deselectAll();
  }
  for (const id of ["line-none", "time-hover"]) byId(id).textContent = "";
  byId("line").value = "";
  byId("segments-hidden").hidden = true;
  document.activeElement.blur();
  window.scrollTo(0, 0);
}"""


@dataclass(frozen=True, slots=True)
class Tab:
    """A page in the browser. `complaints`: errors and warnings of its console; `requests`: other files it loads."""

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

    def keep_state(self) -> Tab:
        """Remember the state of the report page for `reset`."""
        self.page.evaluate(_KEEP)
        return self

    def reset(self) -> Tab:
        """Put the report page back into the remembered state, without a selection, as if it was opened anew."""
        self.page.mouse.move(0, 0)
        self.page.evaluate(_RESET)
        self.drawn()
        return self


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
        """Open a file or an address in a new window. `before`: a script that runs first."""
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
