"""The numbers of a camera and its cover, by the names that the ray path gives them: camera.fx,
camera.k1, cover.thickness.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.cover_section import CORRELATIONS
from calib.session.glass import Glass
from calib.session.parameter_names import CAMERA
from calib.session.schema import Number, Section

Array = NDArray[np.float64]


def numbers_of(intrinsics: Intrinsics, cover: Cover) -> dict[str, Number]:
    """Return the numbers by name, the cover's first, then the camera's."""
    return cover.numbers | camera_numbers(intrinsics)


def camera_numbers(intrinsics: Intrinsics) -> dict[str, Number]:
    """Return the camera's numbers by name."""
    k = intrinsics
    numbers = dict(zip(CAMERA.pinhole, (k.fx, k.fy, k.cx, k.cy), strict=True))
    return numbers | {
        CAMERA.of(name): number for name, number in zip(k.names, k.distortion, strict=True)
    }


def unknown_names(intrinsics: Intrinsics, cover: Cover) -> tuple[str, ...]:
    """Return the names of the unknown numbers."""
    numbers = numbers_of(intrinsics, cover)
    return tuple(name for name, number in numbers.items() if number.unknown)


def replace_numbers(
    intrinsics: Intrinsics, cover: Cover, numbers: Mapping[str, Number]
) -> tuple[Intrinsics, Cover]:
    """Return the description with some numbers replaced. Correlations and the glass's prior are
    dropped: they do not hold for the new numbers.
    """
    camera = {
        name: numbers.get(name, number) for name, number in camera_numbers(intrinsics).items()
    }
    intrinsics = replace(
        intrinsics,
        fx=camera[CAMERA.fx],
        fy=camera[CAMERA.fy],
        cx=camera[CAMERA.cx],
        cy=camera[CAMERA.cy],
        distortion=tuple(camera[CAMERA.of(name)] for name in intrinsics.names),
        correlations=(),
    )
    return intrinsics, replace(cover.replace_numbers(numbers), correlations=(), glass=None)


def correlations_of(intrinsics: Intrinsics | None, cover: Cover) -> dict[tuple[str, str], float]:
    """Return the correlation of each pair of names, once. Missing pairs are independent."""
    correlations = {}
    if intrinsics:
        names = tuple(camera_numbers(intrinsics))
        for first, row in zip(names[1:], intrinsics.correlations, strict=False):
            for second, value in zip(names, row, strict=False):
                correlations[first, second] = value
    for first, second, value in cover.correlations:
        correlations[first, second] = value
    return correlations


def replace_correlations(
    intrinsics: Intrinsics, cover: Cover, pairs: Mapping[tuple[str, str], float]
) -> tuple[Intrinsics, Cover]:
    """Return the description with these correlations in place of its own."""
    names = tuple(camera_numbers(intrinsics))
    rows = tuple(
        tuple(
            pairs.get((first, second), pairs.get((second, first), 0.0)) for second in names[:count]
        )
        for count, first in enumerate(names)
        if count
    )
    camera_rows = rows if any(map(any, rows)) else ()
    cover_pairs = tuple(
        (first, second, value)
        for (first, second), value in pairs.items()
        if value and not {first, second} <= set(names)
    )
    return replace(intrinsics, correlations=camera_rows), replace(cover, correlations=cover_pairs)


def check_correlations(section: Section, intrinsics: Intrinsics | None, cover: Cover) -> None:
    """Raise InputError for correlations of missing numbers, and for correlations that are
    impossible together.

    Args:
        section: the cover's.
        intrinsics: the camera's, if the session gives them.
        cover: the cover.
    """
    if not (cover.correlations or cover.glass):
        return
    names = [*cover.numbers, *(camera_numbers(intrinsics) if intrinsics else ())]
    for first, second, _ in cover.correlations:
        for name in (first, second):
            if name not in names:
                raise section.error(
                    CORRELATIONS, name, f"names of existing numbers: {', '.join(names)}"
                )
        if first == second or (intrinsics and {first, second} <= set(camera_numbers(intrinsics))):
            raise section.error(
                CORRELATIONS,
                f"{first}, {second}",
                "pairs with a number of the cover: the camera's own are in camera.intrinsics",
            )
    glass = cover.glass
    for name in glass.numbers if glass else ():
        if name not in names:
            raise section.error(
                "glass.covariance_um", name, f"names of existing numbers: {', '.join(names)}"
            )
    correlation = np.eye(len(names))
    for (first, second), value in correlations_of(intrinsics, cover).items():
        i, j = names.index(first), names.index(second)
        correlation[i, j] = correlation[j, i] = value
    key = "glass" if glass else CORRELATIONS
    try:
        np.linalg.cholesky(
            _with_glass(correlation, names, intrinsics, cover, glass) if glass else correlation
        )
    except np.linalg.LinAlgError:
        raise section.error(
            key,
            section.values[key],
            "correlations that are possible together, a positive definite matrix",
        ) from None


def _with_glass(
    correlation: Array, names: list[str], intrinsics: Intrinsics | None, cover: Cover, glass: Glass
) -> Array:
    """Return the correlation matrix of the glass's coefficients and the numbers."""
    numbers = cover.numbers | (camera_numbers(intrinsics) if intrinsics else {})
    sigma = np.sqrt(np.clip(glass.covariance.diagonal(), np.finfo(float).tiny, None))
    cross_correlation = np.zeros((len(sigma), len(names)))
    for name, column in zip(glass.numbers, glass.cross_covariance.T, strict=True):
        if numbers[name].sigma:
            cross_correlation[:, names.index(name)] = column / sigma / numbers[name].sigma
    return np.block(
        [
            [glass.covariance / sigma[:, None] / sigma, cross_correlation],
            [cross_correlation.T, correlation],
        ]
    )


def covariance_of(intrinsics: Intrinsics, cover: Cover, names: tuple[str, ...]) -> Array:
    """Return the (K, K) covariance of these numbers, in SI units and px."""
    numbers = numbers_of(intrinsics, cover)
    places = {name: place for place, name in enumerate(names)}
    correlation = np.eye(len(names))
    for (first, second), value in correlations_of(intrinsics, cover).items():
        if first in places and second in places:
            correlation[places[first], places[second]] = value
            correlation[places[second], places[first]] = value
    sigmas = np.array([numbers[name].sigma for name in names])
    return np.asarray(correlation * sigmas[:, None] * sigmas)


def replace_covariance(
    intrinsics: Intrinsics, cover: Cover, names: tuple[str, ...], mean: Array, covariance: Array
) -> tuple[Intrinsics, Cover]:
    """Return the description with these numbers' (K,) values and (K, K) covariance. Other numbers
    stay, and are independent.
    """
    sigmas = np.sqrt(covariance.diagonal())
    intrinsics, cover = replace_numbers(
        intrinsics,
        cover,
        {n: Number(float(m), float(s)) for n, m, s in zip(names, mean, sigmas, strict=True)},
    )
    correlation = covariance / sigmas[:, None] / sigmas
    pairs = {
        (names[i], names[j]): float(correlation[i, j]) for i in range(len(names)) for j in range(i)
    }
    return replace_correlations(intrinsics, cover, pairs)
