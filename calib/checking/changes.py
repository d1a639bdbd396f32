"""What may have changed since a calibration was made, and how a person is told of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.checking.cover_spin import CoverSpin
from calib.checking.picture_mode import PictureMode
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import DEGREES, BoardShape
from calib.effects.cover_offset import CoverOffset
from calib.effects.cover_radius import CoverRadius
from calib.effects.cover_tilt import CoverTilt
from calib.effects.effect import Effect, EffectContext, is_possible
from calib.effects.focal import Focal
from calib.effects.inner_surface import InnerSurface
from calib.effects.lens import Lens
from calib.effects.principal_point import PrincipalPoint
from calib.effects.refractive_index import RefractiveIndex
from calib.effects.thickness import Thickness
from calib.effects.wedge import Wedge

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Words:
    """How a change is told."""

    before: str
    """The sentence up to the size."""
    unit: str = "px"
    """Of the size: px is the root mean square shift of the checked corners, for changes of many
    numbers.
    """
    per_si: float = 1.0
    """How many of the unit make one of the parameters' own."""


KINDS: Mapping[type[Effect], Words] = {
    Focal: Words("the focus has moved: the focal length has changed by", "%", 100.0),
    PrincipalPoint: Words(
        "the lens has moved against the sensor: the principal point is off by", "px", 1.0
    ),
    Lens: Words("the lens distorts otherwise, by"),
    CoverTilt: Words("the cover is turned by", "degrees", float(np.degrees(1.0))),
    CoverSpin: Words(
        "the cover is turned about its own axis by", "degrees", float(np.degrees(1.0))
    ),
    CoverOffset: Words("the cover has moved by", "mm", 1e3),
    CoverRadius: Words("the cover is of another width, which shifts corners by"),
    Thickness: Words("the cover is of another thickness, by", "mm", 1e3),
    RefractiveIndex: Words(
        "the cover is of another glass: its refractive index differs by", "", 1.0
    ),
    Wedge: Words(
        "the cover's faces are turned against each other by", "degrees", float(np.degrees(1.0))
    ),
    InnerSurface: Words("the cover is uneven otherwise, which shifts corners by"),
    BoardScale: Words(
        "the board is not the one of then: it is longer one way than the other by", "%", 100.0
    ),
    BoardShape: Words(
        "the board is not the one of then, or no longer flat: it is bent by", "mm", 1e3
    ),
    PictureMode: Words(
        "the pictures come from another mode, cropped, binned or zoomed: a pixel of the calibration"
        " is so many of theirs:",
        "",
    ),
}
"""In the order of a ray's way; what is about the pictures themselves is last."""
WORDS = {kind.name: words for kind, words in KINDS.items()}


def changes_of(calibration: Calibration) -> tuple[Effect, ...]:
    """Every change that this camera can have had.

    One that the calibration has as an effect is a change of that effect's numbers.
    """
    path, values = calibration.model()
    camera = calibration.camera
    there = EffectContext(calibration.board, camera.width, camera.height, path, values)
    own = {added.effect.name: added.effect for added in calibration.effects}
    found: list[Effect] = []
    for kind in KINDS:
        if kind.name in own:
            found.append(own[kind.name])
        elif kind is BoardShape:  # a board that is bent anew bends like a dish
            found.append(BoardShape(*calibration.board.half, DEGREES[0]))
        elif kind is BoardScale:  # as its words have it
            found.append(BoardScale())
        elif is_possible(kind, path):
            found += kind.propose(there)
    return tuple(found)


@dataclass(frozen=True, slots=True)
class Size:
    """How large a change is, in the unit of its words."""

    value: float
    sigma: float
    unit: str


def size_of(change: Effect, vector: Array, covariance: Array, shift: Array) -> Size:
    """The length of a change.

    Args:
        vector: (k,) its parameters over their scales.
        covariance: (k, k) of them.
        shift: (k, k) px^2: v^T shift v is the mean square shift of the corners.
    """
    words = WORDS[change.name]
    if isinstance(change, PictureMode):
        grown = math.exp(-vector[0] * change.effect_parameters[0].param.scale)
        return Size(
            grown,
            grown * change.effect_parameters[0].param.scale * float(covariance[0, 0]) ** 0.5,
            "",
        )
    scales = np.concatenate(
        [np.full(math.prod(u.param.shape), u.param.scale) for u in change.effect_parameters]
    )
    metric = (
        shift
        if words.unit == "px" and change.name != PrincipalPoint.name
        else np.diag((scales * words.per_si) ** 2)
    )
    value = float(max(0.0, float(vector @ metric @ vector)) ** 0.5)
    slope = metric @ vector / value if value > 0 else np.zeros(len(vector))
    return Size(value, float(max(0.0, float(slope @ covariance @ slope)) ** 0.5), words.unit)
