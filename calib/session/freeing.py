"""Choose the declared numbers of cover and camera that the joint fit estimates: all by default, or
those of the names that people use for them.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from calib.errors import InputError
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.lens import NAMES, RADIAL_POWERS
from calib.session.schema import Number
from calib.session.shapes.layer import WATER, medium_word
from calib.session.shapes.registry import dimensions
from calib.session.tolerances import (
    ANY_WATER,
    FOCAL,
    OWN_CENTRE,
    OWN_COEFFICIENT,
    OWN_FOCAL,
    PRINCIPAL_POINT,
    RADIAL,
    TANGENTIAL,
    TANGENTIAL_NAMES,
)

INTRINSICS = "intrinsics"
ALL = "all"
"""Every number that has a tolerance, and the index of water, except those that the session calls
exact.
"""
AUTO = "auto"
"""The same, as long as the estimates stay within their tolerances or are decisively more probable
than exact numbers.
"""
NONE = "none"
"""Only the numbers that the session states with a sigma."""


def option_names() -> tuple[str, ...]:
    """Return the names of `--free`."""
    options = dict.fromkeys(entry.option for entry in dimensions() if entry.option)
    return (*options, INTRINSICS, AUTO, ALL, NONE)


def free_parameters(
    intrinsics: Intrinsics, cover: Cover, names: Sequence[str]
) -> tuple[Intrinsics, Cover]:
    """Return the description with a sigma for every number of these names; stated sigmas stay.

    Raises:
        InputError: the cover has no such number.
    """
    kinds = cover.dimensions
    options = dict.fromkeys(kind.option for kind in kinds.values() if kind.option)
    missing = [name for name in names if name not in (*options, INTRINSICS, AUTO, ALL, NONE)]
    if missing:
        raise InputError(
            f"--free {missing[0]}: a cover of shape {cover.shape} has no {missing[0]}: "
            f"write some of {', '.join((*options, INTRINSICS))}."
        )
    if ALL in names or AUTO in names:
        intrinsics = _map_intrinsics(intrinsics, _free_unless_exact)
        cover = _with_any_water(_map_cover(cover, _free_unless_exact, tuple(options)))
    if INTRINSICS in names:
        intrinsics = _map_intrinsics(intrinsics, _free_number)
    return intrinsics, _map_cover(cover, _free_number, names)


def own_coefficient_sigmas(intrinsics: Intrinsics) -> dict[str, float]:
    """Return the standard deviation of the prior of each lens coefficient, by its name, for a lens
    that the views of the fit determine.

    A radial term may be a few times as large as the ray's own distance from the axis, at the
    corner of the picture: terms of rational lenses are, and cancel each other. So the prior does
    not depend on the part of the lens that the sensor takes.
    """
    corner = math.hypot(
        intrinsics.cx.value / intrinsics.fx.value, intrinsics.cy.value / intrinsics.fy.value
    )
    return {
        name: OWN_COEFFICIENT.sigma / corner ** RADIAL_POWERS.get(name, 0)
        for name in NAMES[intrinsics.model]
    }


def free_own_intrinsics(intrinsics: Intrinsics) -> Intrinsics:
    """Return the intrinsics with hardly any prior: they come from the views of the fit, which count
    once.
    """
    sigmas = own_coefficient_sigmas(intrinsics).values()
    focal = OWN_FOCAL.sigma * intrinsics.fx.value
    return replace(
        intrinsics,
        fx=Number(intrinsics.fx.value, focal),
        fy=Number(intrinsics.fy.value, focal),
        cx=Number(intrinsics.cx.value, OWN_CENTRE.sigma),
        cy=Number(intrinsics.cy.value, OWN_CENTRE.sigma),
        distortion=tuple(
            Number(number.value, sigma)
            for number, sigma in zip(intrinsics.distortion, sigmas, strict=False)
        ),
        correlations=(),
    )


def _map_cover(
    cover: Cover, change: Callable[[Number, float], Number], options: Sequence[str]
) -> Cover:
    """Change each number of these options, given its tolerance."""
    kinds = cover.dimensions
    changed = {}
    for name, number in cover.numbers.items():
        tolerance = kinds[name].tolerance
        if tolerance and kinds[name].option in options:
            changed[name] = change(number, tolerance.sigma)
    return cover.replace_numbers(changed)


def _with_any_water(cover: Cover) -> Cover:
    """Return the cover with the tolerance of water outside: whoever writes its index seldom knows
    whether it is fresh water's or the sea's. The index of air is exact.
    """
    medium = cover.medium
    if not medium or medium_word(medium.value) != WATER:
        return cover
    return cover.replace_numbers({cover.medium_name: _free_unless_exact(medium, ANY_WATER.sigma)})


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
