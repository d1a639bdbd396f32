"""Words for what has changed in a rig: one explanation that is almost sure, or all probable
ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.checking.changes import WORDS, size_of
from calib.checking.naming import probable_explanations
from calib.checking.result import Change
from calib.rig.check_result import RigChange
from calib.rig.moved_cameras import BAD_PLACEMENT, KINDS, RigHypothesis
from calib.rounding import with_sigma

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Naming:
    """What the words need beside the hypotheses."""

    names: tuple[str, ...]
    """The pictures of the placements."""
    partner: str
    """The other camera of a pair, of which the same motion may be; empty for more cameras."""
    shift: Array
    """(n, n) px^2 over the columns of the products; v^T shift v is the mean square shift of the
    corners.
    """


def name_rig_changes(ranking: Sequence[RigHypothesis], naming: Naming) -> tuple[RigChange, ...]:
    """Return the change that is almost sure, or else all probable changes."""
    return tuple(
        _describe(hypothesis, chance, naming)
        for hypothesis, chance in probable_explanations(ranking)
    )


def size_and_sigma(vector: Array, covariance: Array) -> tuple[float, float]:
    """Return the length of a vector and its standard deviation."""
    length = float(np.linalg.norm(vector))
    slope = vector / length if length else np.full(len(vector), len(vector) ** -0.5)
    return length, max(0.0, float(slope @ covariance @ slope)) ** 0.5


def _describe(hypothesis: RigHypothesis, chance: float, naming: Naming) -> RigChange:
    if hypothesis.change:
        return _describe_own(hypothesis, chance, naming)
    if hypothesis.name in KINDS:
        return _describe_motion(hypothesis, chance, naming)
    words = hypothesis.words
    picture = ""
    if hypothesis.name == BAD_PLACEMENT:
        picture = naming.names[hypothesis.placement]
        words = (
            f"the cameras do not see the board of {picture} at one place, and that of the others"
            " they do: it moved between the pictures"
        )
    return RigChange("", Change(hypothesis.name, words, chance), picture)


def _describe_own(hypothesis: RigHypothesis, chance: float, naming: Naming) -> RigChange:
    assert hypothesis.change
    metric = naming.shift[np.ix_(hypothesis.columns, hypothesis.columns)]
    size = size_of(hypothesis.change, hypothesis.vector, hypothesis.covariance, metric)
    words = f"{hypothesis.camera}: {WORDS[hypothesis.name].start}"
    change = Change(hypothesis.name, words, chance, size.value, size.sigma, size.unit)
    return RigChange(hypothesis.camera, change)


def _describe_motion(hypothesis: RigHypothesis, chance: float, naming: Naming) -> RigChange:
    """Describe how a camera moved: against the motion of everything outside."""
    vector, covariance = -hypothesis.vector, hypothesis.covariance
    sigmas = np.sqrt(covariance.diagonal())
    axes = [f"{kind}.{axis}" for kind in ("turn", "shift") for axis in "xyz"][
        KINDS[hypothesis.name]
    ]
    units = ["rad" if axis.startswith("turn") else "m" for axis in axes]
    parameters = tuple(zip(axes, vector.tolist(), sigmas.tolist(), units, strict=True))
    camera = hypothesis.camera
    against = f" against {naming.partner}" if naming.partner else ""
    picture = naming.names[hypothesis.placement] if hypothesis.placement >= 0 else ""
    moment = ""
    if picture:
        earlier = naming.names[hypothesis.placement - 1]
        moment = f" between {earlier} and {picture}"
    verb = "slipped" if picture else "is no longer where it was: it"
    shift = _part(axes, vector, covariance, "shift", 1e3)
    turn = _part(axes, vector, covariance, "turn", float(np.degrees(1.0)))
    start = f"{camera} {verb}{moment}" if picture else f"{camera} {verb}"
    if shift and turn:
        turned = f"turned by {with_sigma(*turn)} degrees"
        words = f"{start}{',' if picture else ' has'} {turned} and moved{against} by"
        value, sigma, unit = *shift, "mm"
    elif shift:
        words = f"{start}{', moved' if picture else ' has moved'}{against} by"
        value, sigma, unit = *shift, "mm"
    else:
        assert turn
        words = f"{start}{', turned' if picture else ' has turned'}{against} by"
        value, sigma, unit = *turn, "degrees"
    change = Change(hypothesis.name, words, chance, value, sigma, unit, parameters)
    return RigChange(camera, change, picture)


def _part(
    axes: Sequence[str], vector: Array, covariance: Array, kind: str, per_si: float
) -> tuple[float, float] | None:
    """Return the size of a turn or shift and its standard deviation; None if there is none."""
    rows = np.array([axis.startswith(kind) for axis in axes])
    if not rows.any():
        return None
    size, sigma = size_and_sigma(vector[rows], covariance[np.ix_(rows, rows)])
    return size * per_si, sigma * per_si
