"""GJ3: laser modes, delays and the order of statements."""

from __future__ import annotations

from gusjob.diagnostics.rules.examples import HEAD, LASER_ON
from gusjob.diagnostics.rules.registry import ERROR, NOTE, WARNING, rule, variant

POWER_WITHOUT_MODE = rule(
    "GJ301",
    ERROR,
    title="power before a mode",
    text="{word} comes before any LASER MODE of channel {channel}, so its unit is not known",
    why="30 may mean percent, kHz or volts.",
    bad="LASER POWER 30\nLASER MODE DUTY CARRIER 10\n",
    good=LASER_ON + "LINE X 1\nLASER OFF\n",
    section="二.2",
)
WRONG_MODE = rule(
    "GJ302",
    ERROR,
    title="not available in this mode",
    text="{word} needs {wanted}; channel {channel} is in {mode} mode",
    why="The controller does not output it in this mode.",
    bad="LASER MODE ANALOG\nLASER STANDBY FREQ 5kHz DUTY 1\n",
    good="LASER MODE DUTY CARRIER 10\nLASER STANDBY FREQ 5kHz DUTY 1\n",
    section="二.2",
)
DISTANCE_WITHOUT_MODE = rule(
    "GJ303",
    ERROR,
    title="distance follow before a mode",
    text="LASER DISTANCE comes before any LASER MODE of channel {channel}, so its unit is not known",
    why="Its limits are in the unit of the mode.",
    bad="LASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN 0 MAX 50\n",
    good="LASER MODE DUTY CARRIER 10\nLASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN 0 MAX 50\n",
    section="五.2",
)
NEW_STAGE = rule(
    "GJ304",
    NOTE,
    title="new stage",
    text="{word} is set at rest: the motion stops here and a new stage begins",
    why="Stopping takes time. If no stop is intended, put the statement before the path.",
    bad=HEAD + "LINE X 1\nLASER DELAY ON 10 OFF 20\nLINE X 2\n",
    good=HEAD + "LASER DELAY ON 10 OFF 20\nLINE X 1\nLINE X 2\n",
    section="二.2",
)
OFF_DELAY_BELOW_ON = rule(
    "GJ306",
    WARNING,
    title="off delay below on delay",
    text="off delay {off} us is shorter than on delay {on} us; it should usually be longer",
    why="The mark would end too early: the mirrors lag at its end as they do at its start.",
    bad="LASER DELAY ON 60us OFF 50us\n",
    good="LASER DELAY ON 50us OFF 60us\n",
    section="三.2",
)
CRD_LATE = rule(
    "GJ307",
    ERROR,
    title="coordinate system after motion",
    text="CRD comes after the first motion or laser statement of the path: move it before them",
    why="A job uses one coordinate system and one FIFO.",
    bad=HEAD + "LINE X 1\nCRD 2\n",
    good="CRD 2\n" + HEAD + "LINE X 1\n",
)
CHANNEL_WITHOUT_MODE = rule(
    "GJ309",
    ERROR,
    title="channel used without a mode",
    text="channel {channel} is switched on here, but has no LASER MODE",
    why="The channel keeps the mode of the previous program.",
    bad="VEL 100\nACC 10000\nLASER ON\nLINE X 1\nLASER OFF\n",
    good=LASER_ON + "LINE X 1\nLASER OFF\n",
    section="二.2",
)
DISTANCE_UNIT_CHANGED = rule(
    "GJ310",
    ERROR,
    title="distance follow in the unit of another mode",
    text="the limits of {word} are in {unit}, but this mode uses {mode_unit}: set {word} again here, or switch "
    "distance follow off",
    why="Percent would be read as volts.",
    bad="LASER MODE DUTY CARRIER 10\nLASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN 0 MAX 50\nLASER MODE ANALOG\n",
    good="LASER MODE DUTY CARRIER 10\nLASER DISTANCE REF X 0 Y 0 RATIO X 1 Y 1 MIN 0 MAX 50\nLASER DISTANCE OFF\n"
    "LASER MODE ANALOG\n",
    section="五.2",
)
FPK_IN_DUTY2 = rule(
    "GJ311",
    ERROR,
    title="first pulse killer in DUTY2 mode",
    text="FPK outputs its pulse on the switch line, but DUTY2 holds that line at one level (channel {channel})",
    why="The mode and the first pulse killer use the same line. The result is not documented.",
    bad="LASER MODE DUTY2 CARRIER 10\nLASER FPK WIDTH 20 GAP 15 OFFDELAY 10\n",
    good="LASER MODE DUTY CARRIER 10\nLASER FPK WIDTH 20 GAP 15 OFFDELAY 10\n",
    section="一.2, 二.2",
)
DELAY_LONGER_THAN_MARK = rule(
    "GJ312",
    WARNING,
    title="delay longer than its mark",
    text="the on delay of {on} us is longer than this mark, which takes at most {most} us: {lost}",
    why="The delays move the switch points, not the motion: a short mark ends before the emission begins.",
    bad="LASER DELAY ON 1000us OFF 1000us\nLASER MODE DUTY CARRIER 10\nVEL 1000\nACC 1000000\nLASER POWER 30\n"
    "LASER ON\nLINE X 0.1\nLASER OFF\n",
    good="LASER DELAY ON 50us OFF 60us\nLASER MODE DUTY CARRIER 10\nVEL 1000\nACC 1000000\nLASER POWER 30\n"
    "LASER ON\nLINE X 1\nLASER OFF\n",
    section="二.2",
)
GAP_LONGER_THAN_MARK = variant(
    DELAY_LONGER_THAN_MARK,
    text="emission begins {begin} us after the start of this mark (on delay {on} us, FPK GAP {gap} us), which takes at "
    "most {most} us: {lost}",
)
DELAY_LONGER_THAN_JUMP = rule(
    "GJ313",
    WARNING,
    title="off delay longer than the jump",
    text="the off delay of {off} us is longer than the motion to the next {word}, which takes at most {most} us: "
    "the laser does not go off in between",
    why="The jump between the two marks is marked, too.",
    bad="LASER DELAY ON 50us OFF 50ms\nLASER MODE DUTY CARRIER 10\nVEL 1000\nACC 1000000\nLASER POWER 30\nLASER ON\n"
    "LINE X 90\nLASER OFF\nJUMP X 91\nLASER ON\nLINE Y 90\nLASER OFF\n",
    good="LASER DELAY ON 50us OFF 60us\nLASER MODE DUTY CARRIER 10\nVEL 1000\nACC 1000000\nLASER POWER 30\nLASER ON\n"
    "LINE X 90\nLASER OFF\nJUMP X 91\nLASER ON\nLINE Y 90\nLASER OFF\n",
    section="二.2",
)
FPK_LONGER_THAN_JUMP = variant(
    DELAY_LONGER_THAN_JUMP,
    text="emission ends {end} us after the mark before (off delay {off} us, FPK OFFDELAY {killer} us), but the motion "
    "to the next {word} takes at most {most} us: the laser does not go off in between",
)
