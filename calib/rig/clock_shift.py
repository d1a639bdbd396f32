"""The constant difference of two cameras' clocks, where none of their pictures pair by time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View
from calib.rig.placements import Placements
from calib.rig.rig_file import RigDescription

Array = NDArray[np.float64]

MIN_PAIRED = 3
"""The fewest pictures that a shift of the clock must pair: any two times differ by something."""
MIN_FRACTION = 0.8
"""The fraction of the camera's pictures that it must pair."""
MAX_DELAY_S = 0.1
"""A camera may expose so much later than another, s; a larger difference is that of clocks."""


def describe_clock_shift(
    rig: RigDescription, views: Mapping[str, Sequence[View]], placements: Placements
) -> str:
    """Return a sentence on a camera of which no picture was taken at the moment of one of another
    camera, but would be if its clock were shifted; empty if there is none.
    """
    if rig.tolerance_s is None:
        return ""
    seeing = np.zeros(placements.count, np.int64)
    for places in placements.of_views.values():
        seeing[np.unique(places)] += 1
    names = [name for name, camera_views in views.items() if camera_views]
    unpaired = [name for name in names if (seeing[placements.of_views[name]] < 2).all()]
    for name in reversed(unpaired):  # the last of two, whose pictures are compared with the first
        times = _times(views[name])
        for partner in names:
            if partner == name:
                continue
            shift, count = constant_shift(times, _times(views[partner]), rig.tolerance_s)
            if count < max(MIN_PAIRED, MIN_FRACTION * len(times)):
                continue
            order = "later" if shift > 0 else "earlier"
            subject = "all" if count == len(times) else f"{count} of the"
            return (
                f"No picture of {name} shows the board at the same moment as a picture of another"
                f" camera, but {subject} {len(times)} times of {name} are {abs(shift):.3f} s"
                f" {order} than times of {partner}: {_remedy(rig, name, shift)}"
            )
    return ""


def _remedy(rig: RigDescription, name: str, shift: float) -> str:
    """Return what to do about a camera whose times are late by a shift, s."""
    verb = "subtract" if shift > 0 else "add"
    preposition = "from" if shift > 0 else "to"
    file = rig.sessions[name].path / "frames.csv"
    correction = f"{verb} {abs(shift):.3f} {preposition} time_s in {file} if its clock was off."
    if abs(shift) > MAX_DELAY_S or rig.tolerance_s is None:
        return correction
    tolerance_ms = math.ceil(1000 * (abs(shift) + rig.tolerance_s))
    return f"write tolerance_ms: {tolerance_ms} in {rig.file}, or {correction}"


def constant_shift(times: Array, partner_times: Array, tolerance_s: float) -> tuple[float, int]:
    """Return the difference in s at which most of (N,) times have one of (M,) other times within
    the tolerance, and the number of these times.
    """
    differences = np.sort((times[:, None] - partner_times).ravel())
    ends = np.searchsorted(differences, differences + 2 * tolerance_s, side="right")
    first = int((ends - np.arange(len(differences))).argmax())
    shift = float(np.median(differences[first : ends[first]]))
    nearest = np.abs(times[:, None] - shift - partner_times).min(1)
    return shift, int((nearest <= tolerance_s).sum())


def _times(views: Sequence[View]) -> Array:
    return np.array([view.time_s for view in views], np.float64)
