"""Choose the declared numbers of cover and camera that the joint fit estimates: all by default, or
those of the names that people use for them.
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
    OWN_CENTRE,
    OWN_COEFFICIENT,
    OWN_FOCAL,
    PRINCIPAL_POINT,
    RADIAL,
    RADIUS,
    RADIUS_SLOPE,
    TANGENTIAL,
    THICKNESS,
    Tolerance,
)


@dataclass(frozen=True, slots=True)
class FreeOption:
    """A name of `--free`, and the tolerance of its numbers where the session gives them without a
    sigma.
    """

    name: str
    parameters: tuple[str, ...]
    """Names of calib.session.cover.SHAPES. A shape may lack some of them."""
    tolerance: Tolerance


COVER = (
    FreeOption("radius", ("inner_radius",), RADIUS),
    FreeOption("slope", ("radius_slope",), RADIUS_SLOPE),
    FreeOption("offset", ("axis_offset.x", "axis_offset.z"), OFFSET),
    FreeOption("centre", ("centre.x", "centre.y", "centre.z"), OFFSET),
    FreeOption("distance", ("distance",), DISTANCE),
    FreeOption("tilt", ("tilt.x", "tilt.y", "tilt.z"), COVER_TILT),
    FreeOption("thickness", ("thickness",), THICKNESS),
    FreeOption("index", ("refractive_index",), INDEX),
)
INTRINSICS = "intrinsics"
TANGENTIAL_NAMES = ("p1", "p2")
ALL = "all"
"""Every number that has a tolerance, except those that the session calls exact."""
AUTO = "auto"
"""The same, as long as the estimates stay within their tolerances or are decisively more probable
than exact numbers.
"""
NONE = "none"
"""Only the numbers that the session states with a sigma."""
NAMES = (*(option.name for option in COVER), INTRINSICS, AUTO, ALL, NONE)


def free_parameters(
    intrinsics: Intrinsics, cover: Cover, names: Sequence[str]
) -> tuple[Intrinsics, Cover]:
    """Return the description with a sigma for every number of these names; stated sigmas stay.

    Raises:
        InputError: the cover has no such number.
    """
    if ALL in names or AUTO in names:
        intrinsics, cover = _free_all(intrinsics, cover)
    parameters = dict(cover.parameters)
    for option in COVER:
        if option.name not in names:
            continue
        cover_names = [name for name in option.parameters if name in parameters]
        if not cover_names:
            available = [entry.name for entry in COVER if set(entry.parameters) & set(parameters)]
            raise InputError(
                f"--free {option.name}: a cover of shape {cover.shape} has no {option.name}: "
                f"write some of {', '.join((*available, INTRINSICS))}."
            )
        parameters |= {
            name: _free_number(parameters[name], option.tolerance.sigma) for name in cover_names
        }
    if INTRINSICS in names:
        intrinsics = _map_intrinsics(intrinsics, _free_number)
    return intrinsics, replace(cover, parameters=parameters)


def free_own_intrinsics(intrinsics: Intrinsics) -> Intrinsics:
    """Return the intrinsics with hardly any prior: they come from the views of the fit, which count
    once.
    """
    focal = OWN_FOCAL.sigma * intrinsics.fx.value
    return replace(
        intrinsics,
        fx=Number(intrinsics.fx.value, focal),
        fy=Number(intrinsics.fy.value, focal),
        cx=Number(intrinsics.cx.value, OWN_CENTRE.sigma),
        cy=Number(intrinsics.cy.value, OWN_CENTRE.sigma),
        distortion=tuple(Number(n.value, OWN_COEFFICIENT.sigma) for n in intrinsics.distortion),
        correlations=(),
    )


def _free_all(intrinsics: Intrinsics, cover: Cover) -> tuple[Intrinsics, Cover]:
    """Give the tolerance of its kind to every number that has no sigma and is not exact."""
    tolerances = {name: option.tolerance.sigma for option in COVER for name in option.parameters}
    parameters = {
        name: _free_unless_exact(number, tolerances.get(name, 0.0))
        for name, number in cover.parameters.items()
    }
    return _map_intrinsics(intrinsics, _free_unless_exact), replace(cover, parameters=parameters)


def _map_intrinsics(
    intrinsics: Intrinsics, change: Callable[[Number, float], Number]
) -> Intrinsics:
    """Change each number, given its tolerance. A pinhole that is stated to have no distortion keeps
    none.
    """
    lens = intrinsics.distortion if intrinsics.distorts else ()
    sigmas = [
        (TANGENTIAL if name in TANGENTIAL_NAMES else RADIAL).sigma
        for name in intrinsics.names[: len(lens)]
    ]
    distortion = tuple(map(change, lens, sigmas))
    return replace(
        intrinsics,
        fx=change(intrinsics.fx, FOCAL.sigma * intrinsics.fx.value),
        fy=change(intrinsics.fy, FOCAL.sigma * intrinsics.fy.value),
        cx=change(intrinsics.cx, PRINCIPAL_POINT.sigma),
        cy=change(intrinsics.cy, PRINCIPAL_POINT.sigma),
        distortion=distortion,
        correlations=intrinsics.correlations[: 3 + len(lens)],
    )


def _free_number(number: Number, sigma: float) -> Number:
    return number if number.sigma else Number(number.value, sigma)


def _free_unless_exact(number: Number, sigma: float) -> Number:
    return number if number.exact else _free_number(number, sigma)
