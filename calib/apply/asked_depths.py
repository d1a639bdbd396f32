"""Depths that get a sentence: those so near that a part of the picture shows nothing there, because
they lie inside the cover, those so far that millimetres may be meant, and those that the boards
do not support.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from calib.apply.map_uncertainty import describe_sigmas, map_sigmas
from calib.calibration import Calibration
from calib.errors import InputError
from calib.fitting.corner_range import corners_at, distance_range
from calib.fitting.supported_depths import describe_trusted, mistaken_unit, untrusted_depths
from calib.undistortion.ray_field import RayField

NOTABLE = 0.05
"""The fraction of the picture that may be inside the cover without a remark."""
UNUSABLE = 1.0
"""px, the expected error of maps that are hardly of use."""


@dataclass(frozen=True, slots=True)
class ReachedDepths:
    """Depths of which a map can be made, in m, and a sentence on each other one."""

    depths: tuple[float, ...]
    refusals: tuple[str, ...]

    @staticmethod
    def of(field: RayField, depths: Iterable[float]) -> "ReachedDepths":
        reached: list[float] = []
        refusals: list[str] = []
        for depth in dict.fromkeys(depths):
            try:
                field.check_reach(depth)
                reached.append(depth)
            except InputError as error:
                refusals.append(str(error))
        return ReachedDepths(tuple(reached), tuple(refusals))


def describe_depths(calibration: Calibration, depths: Iterable[float]) -> Iterator[str]:
    """Yield a sentence on each depth, m, that lies inside the cover for a part of the picture,
    which therefore is black, and on each that may have been meant in mm or cm.
    """
    field = calibration.ray_field()
    _, farthest = _corner_range(calibration) or (0.0, math.inf)
    for depth in dict.fromkeys(depths):
        if unit := mistaken_unit(depth, farthest):
            name, count = unit
            yield (
                f"{depth:g} is taken as metres: write {depth / count:g} for {depth:g} {name}, and"
                " inf for far away."
            )
        hidden = field.hidden_fraction(depth)
        if hidden > NOTABLE:
            yield (
                f"At {depth:g} m, {100 * hidden:.0f} % of the picture lies inside the cover: these"
                " pixels are black. Depth is in metres, from the lens."
            )


def describe_all(calibration: Calibration, depths: Iterable[float]) -> Iterator[str]:
    """Yield the sentences of `describe_depths`, `describe_unsupported` and `describe_unusable`.

    Raises:
        InputError: the camera sees nothing at one of the depths; there is no sentence before it.
    """
    depths = tuple(depths)
    for depth in depths:
        calibration.ray_field().check_reach(depth)
    yield from describe_depths(calibration, depths)
    yield from describe_unsupported(calibration, depths)
    yield from describe_unusable(calibration, depths)


def describe_unsupported(calibration: Calibration, depths: Iterable[float]) -> Iterator[str]:
    """Yield a sentence on the depths, m, that the boards of a covered camera do not support."""
    corner_range = _corner_range(calibration)
    if not corner_range or not calibration.model()[0].cover:
        return
    near, far = corner_range
    if untrusted := untrusted_depths(depths, near, far):
        yield (
            f"Take care at {', '.join(f'{depth:g} m' for depth in untrusted)}: the boards were"
            f" {near:.2g} to {far:.2g} m away, which supports {describe_trusted(near, far)}."
            f"{_expected_error(calibration, untrusted)}"
        )


def describe_unusable(calibration: Calibration, depths: Iterable[float]) -> Iterator[str]:
    """Yield a sentence on a calibration of another medium, without views there, whose maps have a
    large expected error at one of the depths, m. That of others is in their verdict.
    """
    if len(calibration.views):
        return
    sigmas = map_sigmas(calibration, list(dict.fromkeys(depths)))
    if large := {depth: sigma for depth, sigma in sigmas.items() if sigma > UNUSABLE}:
        yield (
            f"Do not use these maps yet. Expected error (sigma): {describe_sigmas(large)}. Take"
            " three pictures of the board in the medium that is outside of the cover now, and"
            " update the calibration with them: calib check CALIBRATION PICTURES --update."
        )


def _expected_error(calibration: Calibration, depths: list[float]) -> str:
    """Return a sentence on the standard deviation of the maps at these depths, m; "" without it."""
    listed = describe_sigmas(map_sigmas(calibration, depths))
    return f" Expected error of the maps (sigma): {listed}." if listed else ""


def _corner_range(calibration: Calibration) -> tuple[float, float] | None:
    """Return how far away the nearest and the farthest corner were, m; None without corners."""
    corners = corners_at(calibration)
    return distance_range(corners[:, 2]) if len(corners) else None
