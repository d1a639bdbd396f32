"""`--free`: numbers of the cover and the camera that the joint fit is to estimate, by the names that people use for them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from calib.errors import InputError
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.schema import Number
from calib.session.tolerances import (
    COVER_TILT,
    DISTANCE,
    FOCAL,
    INDEX,
    OFFSET,
    PRINCIPAL_POINT,
    RADIAL,
    RADIUS,
    RADIUS_SLOPE,
    TANGENTIAL,
    THICKNESS,
    Tolerance,
)


@dataclass(frozen=True, slots=True)
class Freeable:
    """One name of `--free`, and how well its numbers are known where the session gives them without a sigma."""

    name: str
    parameters: tuple[str, ...]
    """Of calib.session.cover.SHAPES; those that the shape does not have are left out."""
    tolerance: Tolerance


COVER = (
    Freeable("radius", ("inner_radius",), RADIUS),
    Freeable("slope", ("radius_slope",), RADIUS_SLOPE),
    Freeable("offset", ("axis_offset.x", "axis_offset.z"), OFFSET),
    Freeable("centre", ("centre.x", "centre.y", "centre.z"), OFFSET),
    Freeable("distance", ("distance",), DISTANCE),
    Freeable("tilt", ("tilt.x", "tilt.y", "tilt.z"), COVER_TILT),
    Freeable("thickness", ("thickness",), THICKNESS),
    Freeable("index", ("refractive_index",), INDEX),
)
INTRINSICS = "intrinsics"
TANGENTIAL_PLACES = (2, 3)
"""Of p1 and p2 among OpenCV's coefficients."""
NAMES = (*(freeable.name for freeable in COVER), INTRINSICS)


def with_free(intrinsics: Intrinsics, cover: Cover, names: Sequence[str]) -> tuple[Intrinsics, Cover]:
    """The same description with a sigma for every number of these names; stated sigmas stay.

    Raises:
        InputError: the cover has no such number.
    """
    parameters = dict(cover.parameters)
    for freeable in COVER:
        if freeable.name not in names:
            continue
        own = [name for name in freeable.parameters if name in parameters]
        if not own:
            has = [f.name for f in COVER if set(f.parameters) & set(parameters)]
            raise InputError(
                f"--free {freeable.name}: a cover of shape {cover.shape} has no {freeable.name}: "
                f"write some of {', '.join((*has, INTRINSICS))}."
            )
        parameters |= {name: _freed(parameters[name], freeable.tolerance.sigma) for name in own}
    if INTRINSICS in names:
        fx, fy = (_freed(number, FOCAL.sigma * number.value) for number in (intrinsics.fx, intrinsics.fy))
        cx, cy = (_freed(number, PRINCIPAL_POINT.sigma) for number in (intrinsics.cx, intrinsics.cy))
        lens = intrinsics.distortion if any(number.value for number in intrinsics.distortion) else ()
        intrinsics = Intrinsics(
            fx, fy, cx, cy, tuple(_freed(number, (TANGENTIAL if i in TANGENTIAL_PLACES else RADIAL).sigma) for i, number in enumerate(lens))
        )
    return intrinsics, replace(cover, parameters=parameters)


def _freed(number: Number, sigma: float) -> Number:
    return number if number.sigma else Number(number.value, sigma)
