"""Reasons from the pictures that a rig's fit does not use: a camera that slipped, or many pictures
that do not belong together.

The fit leaves out pictures that contradict the others. If a camera slips early or late in a
recording, these are all pictures before or after the slip, and the others fit well. Pictures that
are left out for other reasons are seldom all at one end.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import comb

import numpy as np

from calib.rig.rig import Rig
from calib.rig.rig_content import DISAGREEING

MAX_CHANCE = 0.01
"""The chance up to which pictures that are left out stand at one end: more is no sign of a slip."""
MAX_SHARE = 0.2
"""The share of a camera's pictures that may be left out without a word."""
MIN_COUNT = 3
"""The fewest pictures that are left out for a reason of their own."""


@dataclass(frozen=True, slots=True)
class LeftOutViews:
    """The pictures of one camera that contradict the rig, among those that it shares."""

    files: tuple[str, ...]
    """Their names, in order."""
    count: int
    """The number of pictures, with those that the fit uses."""
    next_file: str
    """The first picture after them, if they are the first pictures; else empty."""
    is_run: bool
    """True if they are the first or the last pictures, by more than chance."""


def describe_left_out(rig: Rig) -> Iterator[str]:
    """Yield a sentence for each set of cameras whose pictures contradict the rig."""
    by_views: dict[LeftOutViews, list[str]] = {}
    for name in rig.names:
        views = left_out_views(rig, name)
        if views.is_run or len(views.files) > max(MIN_COUNT - 1, MAX_SHARE * views.count):
            by_views.setdefault(views, []).append(name)
    for views, names in by_views.items():
        yield _sentence(views, " and ".join(names))


def left_out_views(rig: Rig, name: str) -> LeftOutViews:
    """Return the pictures of a camera that contradict the rig."""
    rejected = {
        view.file
        for view in rig.record.rejected
        if view.camera == name and view.reason in DISAGREEING
    }
    shared = rig.cameras_seeing[rig.of_views[name]] > 1
    used = [rig.calibrations[name].views[index].name for index in np.flatnonzero(shared)]
    files = sorted({*used, *rejected})
    places = [place for place, file in enumerate(files) if file in rejected]
    count = len(places)
    is_first = places == list(range(count))
    is_last = places == list(range(len(files) - count, len(files)))
    is_run = count >= MIN_COUNT and (is_first or is_last) and count < len(files)
    return LeftOutViews(
        files=tuple(files[place] for place in places),
        count=len(files),
        next_file=files[count] if is_run and is_first else "",
        is_run=is_run and 2 / comb(len(files), count) < MAX_CHANCE,
    )


def _sentence(views: LeftOutViews, names: str) -> str:
    count = len(views.files)
    if not views.is_run:
        return (
            f"{count} of the {views.count} pictures that {names} shares with other cameras do not"
            " fit the rig and are not used: check that pictures of one placement are of the same"
            " moment, and hold the board still."
        )
    if views.next_file:
        order, moment, state = "first", f"before {views.next_file}", "later"
        advice = "If the cameras still stand as in these, remove the first ones, and fit again."
    else:
        order, moment, state = "last", f"before {views.files[0]}", "earlier"
        advice = "The cameras may no longer be there: record the rig again."
    return (
        f"the {order} {count} pictures of {names} do not fit the others: a camera may have slipped"
        f" {moment}. The calibration is that of the {state} pictures. {advice}"
    )
