"""Which rules have a fix: the function of each in diagnostics/fixes, as module and name.

They are named here, below the fixes themselves, since `gusjob explain` must not import what a fix needs.
"""

from __future__ import annotations

FIX_OF_RULE = {
    "GJ101": "syntax.fix_line",
    "GJ102": "syntax.fix_line",
    "GJ143": "keywords.upper_case",
    "GJ306": "setup.off_delay",
    "GJ401": "laser.left_on",
    "GJ805": "setup.sky_writing_off",
}
