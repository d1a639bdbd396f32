"""`--free`: numbers of the cover and the camera that the joint fit is to estimate, by the names that people use for them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from calib.errors import InputError
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.schema import Number


@dataclass(frozen=True, slots=True)
class Freeable:
    """One name of `--free`, and how well its numbers are known where the session gives them without a sigma."""

    name: str
    numbers: tuple[str, ...]
    """Of calib.session.cover.SHAPES; those that the shape does not have are left out."""
    sigma: float
    """SI units"""


COVER = (
    Freeable("radius", ("inner_radius",), 1e-3),
    Freeable("slope", ("radius_slope",), 0.01),
    Freeable("offset", ("axis_offset.x", "axis_offset.z"), 1e-3),
    Freeable("centre", ("centre.x", "centre.y", "centre.z"), 1e-3),
    Freeable("distance", ("distance",), 5e-3),
    Freeable("tilt", ("tilt.x", "tilt.y", "tilt.z"), math.radians(1)),
    Freeable("thickness", ("thickness",), 3e-4),
    Freeable("index", ("refractive_index",), 0.02),
)
"""Sigmas: what a maker's drawing and a mount by hand leave open."""
INTRINSICS = "intrinsics"
FOCAL_SIGMA, CENTRE_SIGMA, COEFFICIENT_SIGMA = 0.01, 10.0, 0.01
"""Of the focal length, px, and of each distortion coefficient: about what several calibrations of one camera scatter by."""
NAMES = (*(freeable.name for freeable in COVER), INTRINSICS)


def with_free(intrinsics: Intrinsics, cover: Cover, names: Sequence[str]) -> tuple[Intrinsics, Cover]:
    """The same description with a sigma for every number of these names; stated sigmas stay.

    Raises:
        InputError: the cover has no such number.
    """
    numbers = dict(cover.numbers)
    for freeable in COVER:
        if freeable.name not in names:
            continue
        own = [name for name in freeable.numbers if name in numbers]
        if not own:
            has = [f.name for f in COVER if set(f.numbers) & set(numbers)]
            raise InputError(
                f"--free {freeable.name}: a cover of shape {cover.shape} has no {freeable.name}: "
                f"write some of {', '.join((*has, INTRINSICS))}."
            )
        numbers |= {name: _freed(numbers[name], freeable.sigma) for name in own}
    if INTRINSICS in names:
        fx, fy = (_freed(number, FOCAL_SIGMA * number.value) for number in (intrinsics.fx, intrinsics.fy))
        cx, cy = (_freed(number, CENTRE_SIGMA) for number in (intrinsics.cx, intrinsics.cy))
        lens = intrinsics.distortion if any(number.value for number in intrinsics.distortion) else ()
        intrinsics = Intrinsics(fx, fy, cx, cy, tuple(_freed(number, COEFFICIENT_SIGMA) for number in lens))
    return intrinsics, replace(cover, numbers=numbers)


def _freed(number: Number, sigma: float) -> Number:
    return number if number.sigma else Number(number.value, sigma)
