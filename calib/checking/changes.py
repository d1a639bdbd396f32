"""The changes that a check considers, and their wording."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.checking.cover_spin import CoverSpin
from calib.checking.picture_mode import PictureMode, StretchedMode
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import DEGREES, BoardShape
from calib.effects.cover_offset import CoverOffset
from calib.effects.cover_radius import CoverRadius
from calib.effects.cover_tilt import CoverTilt
from calib.effects.effect import Effect, EffectContext, is_possible
from calib.effects.focal import Focal
from calib.effects.inner_surface import InnerSurface
from calib.effects.lens import LensEffect
from calib.effects.principal_point import PrincipalPoint
from calib.effects.refractive_index import RefractiveIndex
from calib.effects.thickness import Thickness
from calib.effects.wedge import Wedge

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Words:
    """The wording of a change."""

    start: str
    """The sentence up to the size."""
    unit: str = "px"
    """The unit of the size. For changes of many numbers, the size is the root mean square shift of
    the checked corners in px.
    """
    per_si: float = 1.0
    """The factor from the parameters' SI unit to the unit of the size."""


KINDS: Mapping[type[Effect], Words] = {
    Focal: Words("the focus has moved: the focal length has changed by", "%", 100.0),
    PrincipalPoint: Words(
        "the lens has moved against the sensor: the principal point has shifted by", "px", 1.0
    ),
    LensEffect: Words("the lens distortion has changed, by"),
    CoverTilt: Words("the cover has turned by", "degrees", float(np.degrees(1.0))),
    CoverSpin: Words(
        "the cover has turned about its own axis by", "degrees", float(np.degrees(1.0))
    ),
    CoverOffset: Words("the cover has moved by", "mm", 1e3),
    CoverRadius: Words("the cover has another radius, which shifts corners by"),
    Thickness: Words("the thickness of the cover differs by", "mm", 1e3),
    RefractiveIndex: Words("the cover has another glass: its refractive index differs by", "", 1.0),
    Wedge: Words(
        "the faces of the cover are turned against each other by", "degrees", float(np.degrees(1.0))
    ),
    InnerSurface: Words("the cover is uneven in another way, which shifts corners by"),
    BoardScale: Words(
        "the board is not that of the calibration: its two sides differ in scale by", "%", 100.0
    ),
    BoardShape: Words("the board is not that of the calibration, or it has bent, by", "mm", 1e3),
    PictureMode: Words(
        "the pictures come from another mode, cropped, binned or zoomed; their pixels per pixel of"
        " the calibration:",
        "",
    ),
    StretchedMode: Words(
        "the pictures come from another mode, which stretches them; the width of a pixel over its"
        " height, in pixels of the calibration:",
        "",
    ),
}
"""The kinds of changes with their wording, in the order of the ray path; those of the pictures
themselves are last.
"""
WORDS = {kind.name: words for kind, words in KINDS.items()}


def changes_of(calibration: Calibration) -> tuple[Effect, ...]:
    """Return every change that applies to this camera.

    If the calibration has an effect of the same name, the change is one of that effect's numbers.
    """
    path, values = calibration.model()
    camera = calibration.camera
    context = EffectContext(calibration.board, camera.width, camera.height, path, values)
    effects = {added.effect.name: added.effect for added in calibration.effects}
    changes: list[Effect] = []
    for kind in KINDS:
        if kind.name in effects:
            changes.append(effects[kind.name])
        elif kind in (BoardShape, BoardScale) and not calibration.board.is_flat:
            continue
        elif kind is BoardShape:  # a newly bent board is dish-shaped
            changes.append(BoardShape(*calibration.board.half, DEGREES[0]))
        elif kind is BoardScale:  # matches its wording
            changes.append(BoardScale())
        elif is_possible(kind, path):
            changes += kind.propose(context)
    return tuple(changes)


@dataclass(frozen=True, slots=True)
class Size:
    """The size of a change, in the unit of its wording."""

    value: float
    sigma: float
    unit: str


def size_of(change: Effect, vector: Array, covariance: Array, shift: Array) -> Size:
    """Return the size of a change.

    Args:
        vector: (k,) the parameters over their scales.
        covariance: (k, k) the covariance of `vector`.
        shift: (k, k) px^2; v^T shift v is the mean square shift of the corners.
    """
    words = WORDS[change.name]
    if isinstance(change, PictureMode):
        ratio, unknown = change.size(vector)
        return Size(ratio, ratio * unknown.param.scale * float(covariance[0, 0]) ** 0.5, "")
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
