"""The causes by which the cameras of a rig disagree on where the board is: their names, words and
physical limits.
"""

from __future__ import annotations

from dataclasses import dataclass

from calib.effects.board_flex import BoardFlex
from calib.effects.rolling_shutter import RollingShutter
from calib.rig.moved_cameras import SHIFT_SPREAD, TURN_SPREAD
from calib.session import tolerances

LATENESS = tolerances.Tolerance(
    0.02, "s", 1e-3, "half of the interval of a camera that runs freely at 25 pictures a second"
)
FLEX_TURN = tolerances.Tolerance(
    TURN_SPREAD, "rad", 1e-4, "a mount that gives by a quarter of a degree is loose to the touch"
)
FLEX_SHIFT = tolerances.Tolerance(
    SHIFT_SPREAD, "m", 1e-4, "a mount that gives by two millimetres is loose to the eye"
)


@dataclass(frozen=True, slots=True)
class RigEffect:
    """A physical cause by which cameras disagree."""

    name: str
    description: str
    """One plain sentence for people who do not know the effect by its name."""
    advice: str
    """The advice for separating it from the others: the end of "To separate them, ..."."""


SYNC_OFFSET = RigEffect(
    "sync_offset",
    "One camera exposes later than the others, and the board moves meanwhile.",
    "record bursts of a moving board with time_s in frames.csv, and some placements of a board that"
    " stands still",
)
RIG_FLEX = RigEffect(
    "rig_flex",
    "The mounting of a camera differs from placement to placement.",
    "hold the board still, on a tripod, and load the rig by hand between the placements",
)
RIG_SLIP = RigEffect(
    "rig_slip",
    "A camera slipped in its mounting at one moment of the recording.",
    "tighten the mounting, and record again without touching it",
)
ROLLING_SHUTTER = RigEffect(
    RollingShutter.name,
    RollingShutter.description,
    "hold the board still, or on a tripod, for some placements",
)
"""The effect of single cameras that needs numbers in every placement: of one camera, or of all that
may have a rolling shutter, which see the same motion of the board.
"""
RIG_EFFECTS = (SYNC_OFFSET, RIG_FLEX, RIG_SLIP)
"""Every effect that rigs alone have, in the order in which reports list them."""
BOARD_FLEX = RigEffect(
    BoardFlex.name,
    "The board bends differently in every placement.",
    "glue the board to something stiff, or support it in the same way in every placement",
)
"""The effect of single cameras that a rig's diagnosis finds too: all cameras see the same bend."""
