"""Start, step and number of iterations of a loop."""

from __future__ import annotations

from typing import Any

import numpy as np
from msgspec import Struct

from gusjob.diagnostics import rules
from gusjob.frontend.expand.evaluator import Evaluator, Site, kind_words
from gusjob.frontend.expand.lanes import Lanes, any_lane
from gusjob.frontend.expand.program import Loop, split_constants
from gusjob.frontend.parse.operators import PLAIN, NumberType, Typing
from gusjob.i18n.phrases import Phrase, both_of
from gusjob.kinematics.arrays import Floats
from gusjob.kinematics.float_noise import settled

_NO_ITERATION = np.float64(0)


class LoopRange(Struct, frozen=True):
    """Start, step and number of iterations, each for all lanes or for each; the kind of the loop's variable.

    `is_faulty`: some lane has no iterations because of an error.
    """

    start: Any
    step: Any
    count: Any
    kind: NumberType
    is_faulty: bool = False

    def by_lane(self, lanes: int) -> tuple[Floats, Floats, Floats]:
        """Start, step and number of iterations of each lane."""
        start, step, count = (np.broadcast_to(value, lanes) for value in (self.start, self.step, self.count))
        return start, step, count


def loop_range(loop: Loop, evaluator: Evaluator, lanes: Lanes) -> LoopRange:
    """Compute the bounds of a loop; what is wrong with them is reported."""
    bounds, kinds = [], []
    constants = split_constants(loop.constants, loop.bounds)
    for number, (bound, own) in enumerate(zip(loop.bounds, constants, strict=True)):
        site = Site(lanes, loop.line, f"#{number}")
        value, kind = evaluator.number(bound, own, site)
        bounds.append(evaluator.bound(value, kind, site))
        kinds.append(kind)
    if len(bounds) == 1:
        count = _repeat_count(bounds[0], kinds[0], evaluator, Site(lanes, loop.line, "#0"))
        faulty = any_lane((count == 0) & (bounds[0] != 0))
        return LoopRange(np.float64(0), np.float64(1), count, PLAIN, faulty)
    start, end = bounds[0], bounds[1]
    step = bounds[2] if len(bounds) > 2 else np.float64(1)
    if any(kind != kinds[0] for kind in kinds) and not any(np.all(np.isnan(bound)) for bound in bounds):
        fields = {"operator": "FOR", "wants": Typing.SAME.value, "given": both_of(map(kind_words, kinds))}
        evaluator.report(rules.UNIT_MISMATCH, Site(lanes, loop.line, ""), **fields)
        return LoopRange(start, step, _NO_ITERATION, PLAIN, True)
    if np.any(step == 0):
        hint = Phrase("the loop would never end")
        site = Site(lanes, loop.line, "#2")
        evaluator.report_where(rules.LOOP_COUNT, site, step == 0, 1, what="STEP", value=0.0, hint=hint)
    # A last iteration that rounding has moved past the end still counts.
    count = np.floor((end - start) / step * (1 + 1e-12) + 1e-9) + 1
    counted = np.where((step != 0) & np.isfinite(count), np.maximum(count, 0), 0.0)[()]
    return LoopRange(start, step, counted, kinds[0], any_lane((step == 0) | ~np.isfinite(count)))


def _repeat_count(count: Any, kind: NumberType, evaluator: Evaluator, site: Site) -> Any:
    """The number of iterations of REPEAT."""
    count = settled(np.atleast_1d(count)).reshape(np.shape(count))[()]
    wrong = ~np.isnan(count) & ((count < 0) | (count != np.floor(count)))
    if kind != PLAIN and not np.all(np.isnan(count)):
        fields = {"operator": "REPEAT", "wants": Phrase("takes a plain number"), "given": kind_words(kind)}
        evaluator.report(rules.UNIT_MISMATCH, site, **fields)
        return _NO_ITERATION
    if np.any(wrong):
        value = float(count[wrong][0] if isinstance(count, np.ndarray) else count)
        hint = Phrase("write a whole number, 0 or above")
        how_many = int(np.count_nonzero(wrong))
        evaluator.report_where(rules.LOOP_COUNT, site, wrong, how_many, what="REPEAT", value=value, hint=hint)
    return np.where(wrong | np.isnan(count), 0.0, count)[()]
