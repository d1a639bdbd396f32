"""Is this frame worth keeping; and if not, what is to be done first.

Pure: sightings in, a sentence out. The checks stand in the order in which a person must mend what
    they find, and the first that objects
speaks.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from capture.frames import PAUSE_S
from capture.sighting import Sighting

# squares: the next corner of a board that is seen only in part would lie beyond a border nearer
# than this
BORDER = 1.5
# of white: beyond, more than one white square in twenty has lost its level, and the corners around
# it lean
CLIPPED = 0.05
CONTRAST = 40.0  # grey levels: ten times the noise of a small sensor at a high gain
# px/s: skews a picture by 1 px in the 47 ms that an imx219 reads its rows in; poses take that up to
# 0.02 px (median of 200)
SPEED = 20.0
# px: the board moved so far while the shutter was open, and as far again while its rows were read,
# whatever SPEED says
STREAK = 2.0
# px: here the corners of squares of 15 to 28 px are a third worse than in focus, at 2.5 twice as
# bad, at 3 some are lost
SIGMA = 2.0
MOVED = 1.0  # squares, RMS: nearer, the corners look through nearly the same glass
# squares, RMS after shift, turn and size are taken out: what a tilt by about 15 degrees changes
TILTED = 0.1
SHARED = 0.8  # of the corners that are seen: a view that shows more than that besides is new
AFFINE = 4  # corners that tell an affine motion, and whether it is one

FOUND = "No board in view: hold the whole board in the picture, evenly lit and in focus."
WRONG = (
    "The board in view has more corners than the session's: show the session's board, or correct"
    " its columns and rows."
)
HIDDEN = (
    "Only a part of the board can be made out: uncover all of it, and turn glare and shadow away."
)
GLARE = "White squares are clipped: lower exposure or gain, or turn glare away."
DARK = (
    "White hardly stands out from black: add light, raise exposure or gain, or take shadows from"
    " the board."
)
KNOWN = "This view is already there: move the board elsewhere, tilt it, or change its distance."
WAIT = "Hold the board still for a moment."
MOVING = "The board moves: hold it still."
STREAKED = (
    "Motion streaks the picture: hold the board still, or add light and shorten the exposure."
)
SOFT = "The board is out of focus: set the focus to its distance, or clean lens and cover."
GOOD = "Good view: stay until it is taken, then move on."

SIDES = (("left", "right"), ("top", "bottom"))


@dataclass(frozen=True, slots=True)
class Verdict:
    keep: bool
    sentence: str
    """What the person should do now."""


def judge(
    now: Sighting,
    before: Sighting | None,
    kept: Sequence[NDArray[np.float64]],
    *,
    alone: bool = False,
) -> Verdict:
    """Whether to keep a frame.

    Args:
        now: what was seen in it.
        before: the same of the frame before it; None if there was none: then it is not known
            whether the board is still.
        kept: (count, 2) px each, the corners of the views that the session has; NaN where not seen.
        alone: for a photograph by itself, which only its own blur can tell to have been taken in
            motion.
    """
    for check in CHECKS:
        objection = None if alone and check is still else check(now, before, kept)
        if objection is not None:
            return Verdict(False, objection)
    return Verdict(True, GOOD)


def board_found(
    now: Sighting, _before: Sighting | None, _kept: Sequence[NDArray[np.float64]]
) -> str | None:
    if now.corners is not None:
        return None
    if now.problem:
        return f"{now.problem[0].upper()}{now.problem[1:]}."
    if now.part is None:
        return FOUND
    if now.too_large:
        return WRONG
    return _cut(now, now.part, BORDER * now.square) or HIDDEN


def wholly_inside(
    now: Sighting, _before: Sighting | None, _kept: Sequence[NDArray[np.float64]]
) -> str | None:
    return _cut(now, _corners(now), now.window)


def well_exposed(
    now: Sighting, _before: Sighting | None, _kept: Sequence[NDArray[np.float64]]
) -> str | None:
    if now.exposure is None or now.exposure.contrast < CONTRAST:
        return DARK
    return GLARE if now.exposure.clipped > CLIPPED else None


def new(now: Sighting, _before: Sighting | None, kept: Sequence[NDArray[np.float64]]) -> str | None:
    corners = _corners(now)
    for other in kept:
        both = np.isfinite(corners[:, 0]) & np.isfinite(other[:, 0])
        if both.sum() < SHARED * np.isfinite(corners[:, 0]).sum():
            continue
        here, there = corners[both], other[both]
        if (
            _rms(here - there) < MOVED * now.square
            and _rms(_shape_change(here, there)) < TILTED * now.square
        ):
            return KNOWN
    return None


def still(
    now: Sighting, before: Sighting | None, _kept: Sequence[NDArray[np.float64]]
) -> str | None:
    if before is None or before.corners is None or not 0 < now.time_s - before.time_s < PAUSE_S:
        return WAIT
    both = np.isfinite(_corners(now)[:, 0]) & np.isfinite(before.corners[:, 0])
    if both.sum() < AFFINE:
        return WAIT
    corners, earlier = _corners(now)[both], before.corners[both]
    terms = np.column_stack([corners - corners.mean(0), np.ones(len(corners))])
    smooth = (
        terms @ np.linalg.lstsq(terms, corners - earlier, rcond=None)[0]
    )  # an affine motion: noise of single corners goes
    fastest = np.linalg.norm(smooth, axis=1).max() / (now.time_s - before.time_s)
    return MOVING if fastest > SPEED else None


def sharp(
    now: Sighting, _before: Sighting | None, _kept: Sequence[NDArray[np.float64]]
) -> str | None:
    if now.blur is None or now.blur.sigma > SIGMA:
        return SOFT
    return STREAKED if now.blur.streak > STREAK else None


Check = Callable[[Sighting, Sighting | None, Sequence[NDArray[np.float64]]], str | None]
"""None, or what is to be done. A check may rely on those before it."""

CHECKS: tuple[Check, ...] = (board_found, wholly_inside, well_exposed, new, still, sharp)
"""In the order of what must be mended first: there is no use in holding a view still that the
session has.
"""


def _corners(sighting: Sighting) -> NDArray[np.float64]:
    if sighting.corners is None:
        raise ValueError("This check is for boards that were found.")
    return sighting.corners


def _cut(now: Sighting, points: NDArray, near: float) -> str | None:
    """What to do about (n, 2) px that are nearer than this to a border; None if none are."""
    low, high = np.nanmin(points, 0), np.nanmax(points, 0)
    gaps = np.array([low, (now.width - 1, now.height - 1) - high]).T  # (x and y, start and end)
    axis, end = np.unravel_index(gaps.argmin(), gaps.shape)
    if gaps[axis, end] >= near:
        return None
    sides = SIDES[axis]
    return (
        f"The board is cut off at the {sides[end]}: move it away from the picture's {sides[end]}"
        " border."
    )


def _shape_change(corners: NDArray, other: NDArray) -> NDArray[np.float64]:
    """(count, 2) px from the other view to this one, but for what shifting, turning and scaling the
    other does.
    """
    here, there = (np.asarray(view - view.mean(0)) @ (1, 1j) for view in (corners, other))
    rest = here - there * (np.vdot(there, here) / np.vdot(there, there))
    return np.stack([rest.real, rest.imag], -1)


def _rms(vectors: NDArray) -> float:
    """Of the lengths of (n, 2)."""
    return float(np.sqrt((vectors**2).sum(-1).mean()))
