"""Faults that leave exactly one thing to write are mended in the text: what `gusjob check --fix` does."""

from gusjob.mend.proof import key_of
from gusjob.mend.rounds import Judge, Mended, mended
from gusjob.mend.table import MENDS

__all__ = ["MENDS", "Judge", "Mended", "key_of", "mended"]
