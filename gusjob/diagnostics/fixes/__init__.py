"""Diagnostics that leave exactly one thing to write are mended in the text: what `gusjob check --fix` does."""

from gusjob.diagnostics.fixes.proof import key_of
from gusjob.diagnostics.fixes.rounds import Judge, Mended, mended
from gusjob.diagnostics.fixes.table import MENDS

__all__ = ["MENDS", "Judge", "Mended", "key_of", "mended"]
