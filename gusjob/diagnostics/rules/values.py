"""GJ2: values, units and ranges."""

from __future__ import annotations

from gusjob.diagnostics.rules.examples import HEAD, LASER_ON
from gusjob.diagnostics.rules.registry import ERROR, WARNING, rule, variant

OUT_OF_RANGE = rule(
    "GJ201",
    ERROR,
    title="value out of range",
    text="{what} {value} {unit} is outside {range}{hint}",
    why="The controller refuses the call, or its effect is not documented.",
    bad="LASER MODE DUTY CARRIER 3MHz\n",
    good="LASER MODE DUTY CARRIER 20kHz\n",
    section="二.2",
)
ON_EXCLUDED_END = rule(
    "GJ202",
    WARNING,
    title="value at an excluded limit",
    text="{what} {value} {unit} is at a limit of {range} that the manual excludes (though its own example uses one)",
    why="The manual prints an open interval for the buffered power, but its own example uses the limit.",
    bad=LASER_ON.replace("POWER 30", "POWER 100") + "LINE X 1\nLASER OFF\n",
    good=LASER_ON.replace("POWER 30", "POWER 99.9") + "LINE X 1\nLASER OFF\n",
    section="四.2",
)
WRONG_UNIT = rule(
    "GJ203",
    ERROR,
    title="unit of the wrong kind",
    text="{what} is {wanted}, but {unit} is {kind}{hint}",
    why="In a duty mode, 20 kHz would be read as 20 %.",
    bad=HEAD + "LASER POWER 20kHz\n",
    good=HEAD + "LASER POWER 20%\nLASER ON\nLINE X 1\nLASER OFF\n",
)
NOT_WHOLE = rule(
    "GJ204",
    ERROR,
    title="not a whole number",
    text="{what} {value} {unit} must be a whole number: the argument is an integer{hint}",
    why="The integer argument would cut off the fraction without a message.",
    bad="LASER DELAY ON 10.5us OFF 20us\n",
    good="LASER DELAY ON 10us OFF 20us\n",
    section="二.2",
)
MIN_ABOVE_MAX = rule(
    "GJ205",
    ERROR,
    title="MIN not below MAX",
    text="{what}: MIN {low} must be below MAX {high}",
    why="Limits in the wrong order leave no allowed power.",
    bad="LASER MODE DUTY CARRIER 10 MIN 50 MAX 20\n",
    good="LASER MODE DUTY CARRIER 10 MIN 20 MAX 50\n",
    section="二.2",
)
POWER_CLAMPED = rule(
    "GJ206",
    WARNING,
    title="power outside the mode's limits",
    text="{what} {value} {unit} is outside the mode's {low}..{high} {unit}: the controller clamps it",
    why="The part gets a power other than the one in the job.",
    bad="LASER MODE ANALOG MAX 5\nVEL 100\nACC 10000\nLASER POWER 6\nLASER ON\nLINE X 1\nLASER OFF\n",
    good="LASER MODE ANALOG MAX 8\nVEL 100\nACC 10000\nLASER POWER 6\nLASER ON\nLINE X 1\nLASER OFF\n",
    section="二.2",
)
PULSE_TOO_WIDE = rule(
    "GJ207",
    ERROR,
    title="laser pulse does not fit its period",
    text="at {value} kHz a laser pulse of {width} us takes {duty} % of the period, outside {range}",
    why="A laser pulse must fit into its period at every frequency that the job uses.",
    bad="LASER MODE FREQUENCY WIDTH 100us\nVEL 100\nACC 10000\nLASER POWER 20kHz\nLASER ON\nLINE X 1\nLASER OFF\n",
    good="LASER MODE FREQUENCY WIDTH 10us\nVEL 100\nACC 10000\nLASER POWER 20kHz\nLASER ON\nLINE X 1\nLASER OFF\n",
    section="二.2",
)
CARRIER_TOO_FAST = rule(
    "GJ208",
    ERROR,
    title="frequency above the laser's limit",
    text="{what} {value} kHz is above this laser's highest response frequency of {limit} kHz (machine profile)",
    why="The power of a laser that can't follow the frequency is not known.",
    section="二.2",
)
FOLLOW_SATURATES = rule(
    "GJ209",
    WARNING,
    title="velocity follow saturates",
    text="at the programmed velocity of {velocity} {speed}, velocity follow reaches {value} {unit}, above its MAX of "
    "{high} {unit}",
    why="Above that velocity the power stays at MAX, so the energy per mm falls.",
    bad=HEAD + "LASER FOLLOW RATIO 1 MIN 5 MAX 50\nLASER ON\nLINE X 1\nLASER OFF\n",
    good=HEAD + "LASER FOLLOW MIN 5 MAX 50 AT 100mm/s\nLASER ON\nLINE X 1\nLASER OFF\n",
    section="四.2",
)
UNUSED_POWER = rule(
    "GJ210",
    WARNING,
    title="unused power",
    text="the laser is never on between this {word} and the next one that sets the power",
    why="An unused power was probably meant for a mark that now has another one.",
    bad=LASER_ON + "LINE X 1\nLASER POWER 40\nLASER POWER 50\nLINE X 2\nLASER OFF\n",
    good=LASER_ON + "LINE X 1\nLASER POWER 50\nLINE X 2\nLASER OFF\n",
)
UNUSED_LAST_POWER = variant(UNUSED_POWER, text="the laser is never on after this {word}")
