"""GJ6: the machine profile, and its budget for a process."""

from __future__ import annotations

from gusjob.diagnostics.rules.registry import ERROR, rule

PROFILE_SYNTAX = rule(
    "GJ601",
    ERROR,
    title="machine profile is not TOML",
    text="this machine profile is not valid TOML: {reason}",
    why="Without a readable profile the field and the velocities can't be checked.",
)
PROFILE_UNKNOWN = rule(
    "GJ602",
    ERROR,
    title="unknown entry in the machine profile",
    text="{key} is not an entry of a machine profile{hint}",
    why="A misspelt limit has no effect.",
)
PROFILE_TYPE = rule(
    "GJ603",
    ERROR,
    title="wrong type of value in the machine profile",
    text="{key} must be {wanted}, not {found}",
    why="A limit that is not a number limits nothing.",
)
PROFILE_RANGE = rule(
    "GJ604",
    ERROR,
    title="value out of range in the machine profile",
    text="{key} is {value}; it must be {range}",
    why="A limit beyond what the controller can do protects nothing.",
)
BUDGET_DURATION = rule(
    "GJ605",
    ERROR,
    title="run time above the budget",
    text="the run takes {value} s; the budget of {limit} s ends here",
    why="Machine time is planned with this limit (machine profile, [budget]).",
)
BUDGET_POWER = rule(
    "GJ606",
    ERROR,
    title="power above the budget",
    text="channel {channel} emits {value} {unit}; the budget is {limit} {unit}",
    why="More power than the process was qualified with burns the part (machine profile, [budget]).",
)
BUDGET_ENERGY = rule(
    "GJ607",
    ERROR,
    title="energy per mm above the budget",
    text="this mark of channel {channel} reaches {value} {unit}; the budget is {limit} {unit}",
    why="Where the beam is slower at the same power, it marks deeper (machine profile, [budget]).",
)
BUDGET_CLAMPED = rule(
    "GJ608",
    ERROR,
    title="power clamped longer than the budget",
    text="a limit clamps the power of channel {channel} for {value} ms; the budget is {limit} ms",
    why="Clamped power does not follow: the result differs from the qualified process (machine profile, [budget]).",
)
BUDGET_ON_ERROR = rule(
    "GJ609",
    ERROR,
    title="emission starts too far from its point",
    text="the emission of channel {channel} starts {value} um from the intended start of the mark; the budget "
    "is {limit} um",
    why="A mark that starts too early or too late does not join the others (machine profile, [budget]).",
)
