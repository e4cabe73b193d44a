"""What a user does with a report page in a browser, and what its views show."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from support.browser import Tab, rest

PIXELS = """(points) => points.map(([x, y]) => {
  const { map, layer } = gusjob.path.view;
  const at = map.project([y, x], map.getZoom());
  const tile = Object.values(layer._tiles).find((t) => t.coords.z === map.getZoom()
    && t.coords.x === Math.floor(at.x / 256) && t.coords.y === Math.floor(at.y / 256));
  if (!tile) return [0, 0, 0, 0];
  const k = tile.el.width / 256;
  const px = Math.floor((at.x - tile.coords.x * 256) * k), py = Math.floor((at.y - tile.coords.y * 256) * k);
  const copy = document.createElement("canvas");
  copy.width = copy.height = 3;
  copy.getContext("2d").drawImage(tile.el, px - 1, py - 1, 3, 3, 0, 0, 3, 3);
  const data = copy.getContext("2d").getImageData(0, 0, 3, 3).data;
  let best = [0, 0, 0, 0];
  for (let i = 0; i < data.length; i += 4) if (data[i + 3] > best[3]) best = [...data.slice(i, i + 4)];
  return best;
})"""


def pixels(tab: Tab, points: Iterable[tuple[float, float]]) -> list[list[int]]:
    """The strongest color within a pixel of each point, mm."""
    found: list[list[int]] = tab.page.evaluate(PIXELS, [[float(x), float(y)] for x, y in points])
    return found


def pixel(tab: Tab, x: float, y: float) -> list[int]:
    """The strongest color within a pixel of a point, mm."""
    return pixels(tab, [(x, y)])[0]


def path_point(tab: Tab, x: float, y: float) -> tuple[float, float]:
    """Where a point in mm is on the screen after the map has stopped moving."""
    tab.page.locator("#map").scroll_into_view_if_needed()
    tab.drawn()
    at = tab.page.evaluate(
        """([x, y]) => { const m = gusjob.path.view.map, p = m.latLngToContainerPoint([y, x]);
        const r = m.getContainer().getBoundingClientRect(); return [r.left + p.x, r.top + p.y]; }""",
        [x, y],
    )
    return at[0], at[1]


def click_path(tab: Tab, x: float, y: float) -> None:
    """Click at a point in mm."""
    tab.page.mouse.click(*path_point(tab, x, y))
    rest(tab.page, 100)


def hover_path(tab: Tab, x: float, y: float) -> str:
    """Move the mouse to a point in mm and return the text of the tip.

    The mouse moves again until the tip is shown: a selection may move the map under it.
    """
    tip = tab.page.locator(".tip")
    for _ in range(100):
        left, top = path_point(tab, x, y)
        tab.page.mouse.move(left + 30, top + 30)
        tab.page.mouse.move(left, top)
        rest(tab.page, 200)
        if tip.is_visible():
            break
    return tip.inner_text()


def click_time(tab: Tab, ms: float) -> None:
    tab.page.locator("#time").scroll_into_view_if_needed()
    at = tab.page.evaluate(
        """(t) => { const p = gusjob.time.view.plot, r = p.over.getBoundingClientRect();
        return [r.left + p.valToPos(t, "x"), r.top + 40]; }""",
        ms,
    )
    tab.page.mouse.click(*at)
    rest(tab.page, 100)


def selected(tab: Tab) -> dict[str, Any]:
    """The selection as each view shows it."""
    rest(tab.page, 150)
    found: dict[str, Any] = tab.page.evaluate(
        """() => ({ row: gusjob.selected, hash: location.hash,
        grid: gusjob.table.grids.segments.api.getSelectedRows().map((r) => r.row),
        shown: [...document.querySelectorAll("#segments-grid .ag-row-selected")]
          .map((e) => Number(e.getAttribute("row-id")))[0],
        title: document.getElementById("details-title").textContent,
        marker: gusjob.time.view.marker.hidden ? null : Number(gusjob.time.view.marker.dataset.row),
        line: !!document.querySelector("#map .chosen-line") })"""
    )
    return found


def order(tab: Tab, sort: list[tuple[str, str]], filters: dict[str, Any]) -> list[int]:
    """The rows of the grid after its order and filters are set."""
    tab.page.evaluate(
        """([sort, filters]) => { const { api } = gusjob.table.grids.segments;
        const state = sort.map(([colId, sort], sortIndex) => ({ colId, sort, sortIndex }));
        api.applyColumnState({ state, defaultState: { sort: null } });
        api.setFilterModel(filters); }""",
        [sort, filters],
    )
    rest(tab.page, 300)
    found: list[int] = tab.page.evaluate("[...gusjob.table.grids.segments.order]")
    return found
