"""Find the LASER DELAY or SKYWRITE that brings the ends of marks nearest to their intended positions."""

from gusjob.tune.delays import tune_delays
from gusjob.tune.skywriting import tune_sky_writing
from gusjob.tune.trial import CLOSED_FORM, SEARCH, EndMeasure, TuneResult, TuneRun, run_job, run_text
from gusjob.tune.verdict import Verdict, delay_objective, judge, paired_totals, sky_writing_objective

__all__ = [
    "CLOSED_FORM",
    "SEARCH",
    "EndMeasure",
    "TuneResult",
    "TuneRun",
    "Verdict",
    "delay_objective",
    "judge",
    "paired_totals",
    "run_job",
    "run_text",
    "sky_writing_objective",
    "tune_delays",
    "tune_sky_writing",
]
