"""Find the LASER DELAY or SKYWRITE that brings the ends of marks nearest to their intended positions."""

from gusjob.tune.delays import tune_delays
from gusjob.tune.skywriting import tune_sky_writing
from gusjob.tune.trial import CLOSED_FORM, SEARCH, TuneResult, TuneRun, run_job, run_text

__all__ = ["CLOSED_FORM", "SEARCH", "TuneResult", "TuneRun", "run_job", "run_text", "tune_delays", "tune_sky_writing"]
