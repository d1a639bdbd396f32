"""Which declared numbers of the cover and the camera the joint fit estimates: all by default, or by
the names that people use for them.
"""

from collections.abc import Callable, Sequence
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
    """One name of `--free`, and how well its numbers are known where the session gives them without
    a sigma.
    """

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
TANGENTIAL_NAMES = ("p1", "p2")
ALL = "all"
"""Every number that has a tolerance, those aside that the session calls exact."""
AUTO = "auto"
"""The same as long as the estimates keep to their tolerances, or are decisively more probable than
exact numbers.
"""
NONE = "none"
"""Only what the session states with a sigma."""
NAMES = (*(freeable.name for freeable in COVER), INTRINSICS, AUTO, ALL, NONE)


def with_free(
    intrinsics: Intrinsics, cover: Cover, names: Sequence[str]
) -> tuple[Intrinsics, Cover]:
    """The same description with a sigma for every number of these names; stated sigmas stay.

    Raises:
        InputError: the cover has no such number.
    """
    if ALL in names or AUTO in names:
        intrinsics, cover = _all_free(intrinsics, cover)
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
        intrinsics = _map_intrinsics(intrinsics, _freed)
    return intrinsics, replace(cover, parameters=parameters)


def _all_free(intrinsics: Intrinsics, cover: Cover) -> tuple[Intrinsics, Cover]:
    """With the tolerance of its kind for every number that has neither a sigma nor is exact."""
    tolerances = {
        name: freeable.tolerance.sigma for freeable in COVER for name in freeable.parameters
    }
    parameters = {
        name: _declared(number, tolerances.get(name, 0.0))
        for name, number in cover.parameters.items()
    }
    return _map_intrinsics(intrinsics, _declared), replace(cover, parameters=parameters)


def _map_intrinsics(
    intrinsics: Intrinsics, change: Callable[[Number, float], Number]
) -> Intrinsics:
    """Each number changed, given its tolerance; a pinhole that is stated to have no distortion
    keeps none.
    """
    fx, fy = (
        change(number, FOCAL.sigma * number.value) for number in (intrinsics.fx, intrinsics.fy)
    )
    cx, cy = (change(number, PRINCIPAL_POINT.sigma) for number in (intrinsics.cx, intrinsics.cy))
    lens = intrinsics.distortion if intrinsics.distorts else ()
    sigmas = [
        (TANGENTIAL if name in TANGENTIAL_NAMES else RADIAL).sigma
        for name in intrinsics.names[: len(lens)]
    ]
    distortion = tuple(map(change, lens, sigmas))
    return replace(
        intrinsics,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        distortion=distortion,
        correlations=intrinsics.correlations[: 3 + len(lens)],
    )


def _freed(number: Number, sigma: float) -> Number:
    return number if number.sigma else Number(number.value, sigma)


def _declared(number: Number, sigma: float) -> Number:
    return number if number.exact else _freed(number, sigma)
