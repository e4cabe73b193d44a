"""The page of a run, for the commands that write or serve one."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from gusjob.diagnostics.formats.check_json import diagnostic_object
from gusjob.diagnostics.model import Diagnostic
from gusjob.i18n.phrases import Phrase
from gusjob.pipeline import FileResult, Simulated

if TYPE_CHECKING:
    from gusjob.report.rows import Report


def too_long(report: Report | None) -> str:
    """Return why a run is too long for a page; "" if it is not."""
    from gusjob.view.page.content import MAX_SEGMENTS

    if report is None or len(report) <= MAX_SEGMENTS:
        return ""
    return Phrase(
        "{count:,} segments are too many for a page, which holds up to {most:,}; use gusjob plot, or report "
        "--format parquet",
        most=MAX_SEGMENTS,
        count=len(report),
    )


def html_page(result: FileResult, report: Report | None, *, watched: str = "") -> Iterator[bytes]:
    """Yield the page in pieces. For a job that was not simulated, or is too long, it has the diagnostics only."""
    from gusjob.report.answer import answer_of
    from gusjob.view.page.content import page_of, page_without_run
    from gusjob.view.page.render import render
    from gusjob.view.strokes import strokes_of

    diagnostics = [_with_source(result, diagnostic) for diagnostic in result.diagnostics]
    reason = too_long(report)
    if not isinstance(result, Simulated) or report is None or reason:
        return render(page_without_run(result.path.name, diagnostics, watched, reason, result.overrides))
    answer, strokes = answer_of(report, result.diagnostics), strokes_of(result.trace, result.machine)
    return render(page_of(report, strokes, result.machine, diagnostics, watched, answer))


def _with_source(result: FileResult, diagnostic: Diagnostic) -> dict[str, Any]:
    """Return a diagnostic as in the JSON, but localized and with the text of its line."""
    found = diagnostic_object(diagnostic) | {"message": diagnostic.localized}
    found["source"] = result.text_of(diagnostic.span, diagnostic.path)
    for note, remark in zip(found.get("notes", ()), diagnostic.remarks, strict=False):
        note["message"] = remark.localized
        note["source"] = result.text_of(remark.span, diagnostic.path)
    return found
