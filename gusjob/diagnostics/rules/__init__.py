"""The rules: everything that gusjob reports, with a text, the reason, a bad and a good example.

A module for each family, named after the first digit of its codes. `rules.X` is rule X of any family. The texts are
templates with named fields. The table in grammar/README.md and `gusjob explain` are made from here, and the tests run
every example. Codes are stable: a code is never reused for another problem.
"""

# ruff: noqa: F403, I001  (the order of the modules is the order of the codes)

from __future__ import annotations

from gusjob.diagnostics.rules.registry import RULES as RULES, VARIANTS as VARIANTS
from gusjob.diagnostics.rules.files import *
from gusjob.diagnostics.rules.language import *
from gusjob.diagnostics.rules.values import *
from gusjob.diagnostics.rules.order import *
from gusjob.diagnostics.rules.laser import *
from gusjob.diagnostics.rules.motion import *
from gusjob.diagnostics.rules.profile import *
from gusjob.diagnostics.rules.listings import *
from gusjob.diagnostics.rules.skywriting import *
from gusjob.diagnostics.rules.hardware import *
