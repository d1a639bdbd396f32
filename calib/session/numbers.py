"""The numbers of a camera and its cover by one name each, as the ray path calls them: camera.fx,
camera.k1, cover.thickness.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.session.camera import Intrinsics
from calib.session.cover import CORRELATIONS, Cover
from calib.session.glass import Glass
from calib.session.schema import Number, Section

Array = NDArray[np.float64]


def numbers_of(intrinsics: Intrinsics, cover: Cover) -> dict[str, Number]:
    """The cover's, then the camera's."""
    return {f"cover.{name}": number for name, number in cover.parameters.items()} | camera_numbers(
        intrinsics
    )


def camera_numbers(intrinsics: Intrinsics) -> dict[str, Number]:
    pinhole = {f"camera.{name}": getattr(intrinsics, name) for name in ("fx", "fy", "cx", "cy")}
    return pinhole | {
        f"camera.{name}": number
        for name, number in zip(intrinsics.names, intrinsics.distortion, strict=True)
    }


def with_numbers(
    intrinsics: Intrinsics, cover: Cover, found: Mapping[str, Number]
) -> tuple[Intrinsics, Cover]:
    """The description with some numbers in place of its own, all independent; what was known of the
    glass goes with them.
    """
    parameters = {
        name: found.get(f"cover.{name}", number) for name, number in cover.parameters.items()
    }
    fx, fy, cx, cy, *lens = (
        found.get(name, number) for name, number in camera_numbers(intrinsics).items()
    )
    intrinsics = replace(
        intrinsics, fx=fx, fy=fy, cx=cx, cy=cy, distortion=tuple(lens), correlations=()
    )
    return intrinsics, replace(cover, parameters=parameters, correlations=(), glass=None)


def correlations_of(intrinsics: Intrinsics | None, cover: Cover) -> dict[tuple[str, str], float]:
    """Each pair once. Pairs that are not there are independent."""
    names = tuple(camera_numbers(intrinsics)) if intrinsics else ()
    rows = zip(names[1:], intrinsics.correlations if intrinsics else (), strict=False)
    own = {
        (one, other): value for one, row in rows for other, value in zip(names, row, strict=False)
    }
    return own | {(one, other): value for one, other, value in cover.correlations}


def with_correlations(
    intrinsics: Intrinsics, cover: Cover, pairs: Mapping[tuple[str, str], float]
) -> tuple[Intrinsics, Cover]:
    """The description with these in place of its own."""
    names = tuple(camera_numbers(intrinsics))
    rows = tuple(
        tuple(pairs.get((one, other), pairs.get((other, one), 0.0)) for other in names[:i])
        for i, one in enumerate(names)
        if i
    )
    own = rows if any(map(any, rows)) else ()
    others = tuple(
        (one, other, value)
        for (one, other), value in pairs.items()
        if value and not {one, other} <= set(names)
    )
    return replace(intrinsics, correlations=own), replace(cover, correlations=others)


def check_correlations(section: Section, intrinsics: Intrinsics | None, cover: Cover) -> None:
    """Refuse those of numbers that are not there, and those that cannot all be true.

    Args: section: the cover's.
    """
    if not (cover.correlations or cover.glass):
        return
    names = [f"cover.{name}" for name in cover.parameters] + list(
        camera_numbers(intrinsics) if intrinsics else ()
    )
    for one, other, _ in cover.correlations:
        for name in (one, other):
            if name not in names:
                raise section.wrong(
                    CORRELATIONS, name, f"names of numbers that are there: {', '.join(names)}"
                )
        if one == other or (intrinsics and {one, other} <= set(camera_numbers(intrinsics))):
            raise section.wrong(
                CORRELATIONS,
                f"{one}, {other}",
                "pairs of which one is the cover's; the camera's own are in camera.intrinsics",
            )
    glass = cover.glass
    for name in glass.numbers if glass else ():
        if name not in names:
            raise section.wrong(
                "glass.covariance_um", name, f"names of numbers that are there: {', '.join(names)}"
            )
    correlation = np.eye(len(names))
    for (one, other), value in correlations_of(intrinsics, cover).items():
        i, j = names.index(one), names.index(other)
        correlation[i, j] = correlation[j, i] = value
    key = "glass" if glass else CORRELATIONS
    try:
        np.linalg.cholesky(
            _with_glass(correlation, names, intrinsics, cover, glass) if glass else correlation
        )
    except np.linalg.LinAlgError:
        raise section.wrong(
            key,
            section.values[key],
            "numbers that all can be correlated by, a positive definite matrix",
        ) from None


def _with_glass(
    correlation: Array, names: list[str], intrinsics: Intrinsics | None, cover: Cover, glass: Glass
) -> Array:
    """The correlations of the glass's coefficients, and of the numbers."""
    stated = {f"cover.{name}": number for name, number in cover.parameters.items()}
    stated |= camera_numbers(intrinsics) if intrinsics else {}
    size = np.sqrt(np.clip(glass.covariance.diagonal(), np.finfo(float).tiny, None))
    beside = np.zeros((len(size), len(names)))
    for name, column in zip(glass.numbers, glass.beside.T, strict=True):
        if stated[name].sigma:
            beside[:, names.index(name)] = column / size / stated[name].sigma
    return np.block([[glass.covariance / size[:, None] / size, beside], [beside.T, correlation]])


def covariance_of(intrinsics: Intrinsics, cover: Cover, names: tuple[str, ...]) -> Array:
    """(K, K) of these numbers, in SI units and px."""
    numbers, places = (
        numbers_of(intrinsics, cover),
        {name: place for place, name in enumerate(names)},
    )
    correlation = np.eye(len(names))
    for (one, other), value in correlations_of(intrinsics, cover).items():
        if one in places and other in places:
            correlation[places[one], places[other]] = correlation[places[other], places[one]] = (
                value
            )
    sigmas = np.array([numbers[name].sigma for name in names])
    return np.asarray(correlation * sigmas[:, None] * sigmas)


def with_covariance(
    intrinsics: Intrinsics, cover: Cover, names: tuple[str, ...], mean: Array, covariance: Array
) -> tuple[Intrinsics, Cover]:
    """The description with these numbers, (K,) and (K, K), in place of its own; others stay, and
    are independent.
    """
    sigmas = np.sqrt(covariance.diagonal())
    intrinsics, cover = with_numbers(
        intrinsics,
        cover,
        {n: Number(float(m), float(s)) for n, m, s in zip(names, mean, sigmas, strict=True)},
    )
    correlation = covariance / sigmas[:, None] / sigmas
    pairs = {
        (names[i], names[j]): float(correlation[i, j]) for i in range(len(names)) for j in range(i)
    }
    return with_correlations(intrinsics, cover, pairs)
