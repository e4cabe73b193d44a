"""A comparison of reports as JSON."""

from __future__ import annotations

from typing import Any

import orjson
from msgspec.structs import asdict

from gusjob.report.compare import Comparison, SegmentComparison
from gusjob.simulate.kinds import SegmentKind


def against_json(comparison: Comparison) -> orjson.Fragment:
    """Return the field `against` of the report's JSON.

    `path` and `job` of the earlier report; `tolerance_pct`; `same`; `overrides`: a list of the changed values of -D,
    objects of `name`, `old`, `new`, null where the name was not set; `totals`: a list of the changed ones, objects of
    `what`, `channel`, `unit`, `old`, `new`, `change_pct`; `segments`: null if the earlier report has none, else

    - `matched`: "line", or "order" where line numbers changed;
    - `moved`: by name of a column of segments (or `kind`) columns `row`, `old_row`, `line`, `old`,
      `new`, `change_pct`;
    - `new`: columns `row`, `line`; `vanished`: columns `old_row`, `line`.

    `row` and `old_row` count from 0 in the segments of this report and of the earlier one. `change_pct` is in percent
    of the larger magnitude; null if `old` or `new` is null or a text (`kind`, `unit`).
    """
    return orjson.Fragment(
        orjson.dumps(
            {
                "path": comparison.path,
                "job": comparison.job,
                "tolerance_pct": comparison.tolerance_pct,
                "same": comparison.same,
                "overrides": comparison.overrides,
                "totals": comparison.totals,
                "segments": None if comparison.segments is None else _segments_object(comparison.segments),
            },
            default=asdict,
            option=orjson.OPT_SERIALIZE_NUMPY,
        )
    )


def _segments_object(segments: SegmentComparison) -> dict[str, Any]:
    old_line, new_line = segments.old["line"], segments.new["line"]
    moved = {
        name: {
            "row": segments.new_row[what.pair],
            "old_row": segments.old_row[what.pair],
            "line": new_line[segments.new_row[what.pair]],
            "old": [_word(kind) for kind in what.old] if name == "kind" else what.old,
            "new": [_word(kind) for kind in what.new] if name == "kind" else what.new,
            "change_pct": what.change_pct,
        }
        for name, what in segments.changes.items()
    }
    return {
        "matched": "order" if segments.shifted else "line",
        "moved": moved,
        "new": {"row": segments.appeared, "line": new_line[segments.appeared]},
        "vanished": {"old_row": segments.vanished, "line": old_line[segments.vanished]},
    }


def _word(kind: int) -> str:
    return SegmentKind(kind).word
