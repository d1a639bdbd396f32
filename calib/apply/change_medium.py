"""A calibration for another medium: made in air and used in water, or the other way round. Only
the index outside of the cover is replaced. The camera and the glass stay the same.

The covariance is carried over, so sigma shows what the change of medium makes visible: in air a
window's distance moves no ray, under water it moves every ray. The views are not carried over: they
were taken in the other medium. `Calibration.corners_at` keeps the places of their corners, because
sigma leaves out the rigid motion of all rays that hides most of an error there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.apply.dominant_uncertainty import (
    MAX_SIGMA_PX,
    DominantUncertainty,
    find_dominant_uncertainties,
    sigmas,
)
from calib.apply.map_uncertainty import UndistortedChange, frames_along
from calib.calibration import Calibration
from calib.effects.flat_port import FlatPort
from calib.errors import InputError
from calib.estimation.covariance import regression
from calib.estimation.jacobians import undistorted_jacobian
from calib.estimation.parameters import Parameters
from calib.fit_record.history import MediumChange
from calib.fitting.corner_range import corners_at
from calib.optics.exposure import MIDDLE
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import AMPLITUDES
from calib.session.cover import Cover
from calib.session.dispersion import Dispersion
from calib.session.parameter_names import CAMERA
from calib.session.schema import Number

Array = NDArray[np.float64]

DEPTHS = (0.3, 0.5, 1.0)
"""m: the depths at which the sigma of the maps is reported by default."""
SAMPLED = 400
"""The number of corners, out of all, at which that sigma is computed."""


@dataclass(frozen=True, slots=True, eq=False)
class Immersion:
    """A calibration in its new medium, and the sigma of its maps there: px, root mean square over
    the corners, at each depth.
    """

    calibration: Calibration
    depths: tuple[float, ...]
    """m"""
    before_px: tuple[float, ...]
    """Sigma in the original medium; empty if the fit estimated no covariance."""
    after_px: tuple[float, ...]
    """Sigma in the new medium; empty if the fit estimated no covariance."""
    dominant: tuple[DominantUncertainty, ...]
    """The groups of parameters that dominate sigma in the new medium, the largest first."""
    other_face_px: tuple[float, ...]
    """The error of the maps if all unevenness were on the glass's inner face; empty without a
    relief.
    """
    unexplained: tuple[str, ...]
    """The names of effects that correct an error without a physical cause."""

    @property
    def medium(self) -> Number:
        """The index of the new medium."""
        medium = self.calibration.cover.medium
        assert medium
        return medium

    @property
    def unknown(self) -> bool:
        """True if sigma in the new medium exceeds MAX_SIGMA_PX at one of the depths."""
        return any(sigma > MAX_SIGMA_PX for sigma in self.after_px)


def immerse(
    calibration: Calibration,
    medium: Number,
    depths: Sequence[float] = DEPTHS,
    dispersion: Dispersion | None = None,
) -> Immersion:
    """Put a calibration into a medium of another index, with its dispersion if it is known.

    Raises:
        InputError: the calibration does not describe its window or dome, or no ray leaves the
            cover into that medium.
    """
    wet = replace_medium(calibration, medium, dispersion)
    rows = corners_at(calibration)
    if not np.isfinite(wet.rays(rows[:, :2])[0]).any():
        raise InputError(
            f"no ray of this camera leaves its cover into an index of {medium.value:g}: check the"
            " cover's numbers."
        )
    sampled_pixels = rows[:: max(1, len(rows) // SAMPLED), :2]
    original = _map_jacobian(calibration, sampled_pixels)
    changed = _map_jacobian(wet, sampled_pixels)
    return Immersion(
        calibration=wet,
        depths=tuple(depths),
        before_px=sigmas(original, calibration.covariance, depths),
        after_px=sigmas(changed, wet.covariance, depths),
        dominant=tuple(find_dominant_uncertainties(wet, changed, depths)),
        other_face_px=tuple(_other_face_errors(calibration, wet, rows, depths)),
        unexplained=tuple(added.effect.name for added in wet.effects if not added.effect.has_cause),
    )


def replace_medium(
    calibration: Calibration, medium: Number, dispersion: Dispersion | None = None
) -> Calibration:
    """Return the calibration with another index outside of its cover, without its views.

    Raises:
        InputError: the calibration does not describe its window or dome.
    """
    if any(isinstance(added.effect, FlatPort) for added in calibration.effects):
        raise InputError(
            "the window of this calibration was found by the diagnosis, and where it stands is not"
            " known in air: describe it under cover in session.yaml, with its distance_mm and"
            " thickness_mm, and fit the session again."
        )
    original = calibration.cover.medium
    if not original:
        raise InputError(
            "this calibration has no cover, and what water does is done at a window or dome:"
            " describe it under cover in session.yaml, and fit the session again."
        )
    declared = calibration.declared
    change = MediumChange(
        from_index=original.value,
        to_index=medium.value,
        sigma=medium.sigma,
        calibration=calibration.digest,
    )
    wet = replace(
        calibration,
        cover=calibration.cover.replace_medium(medium, dispersion),
        views=(),
        poses=calibration.poses[:0],
        covariance=calibration.covariance[:0, :0],
        rejected=(),
        stages=(),
        corners_at=corners_at(calibration),
        stated=replace(declared, cover=declared.cover.replace_medium(medium, dispersion)),
        history=replace(calibration.history, medium_change=change),
    )
    if not calibration.covariance.size:
        return wet
    covariance = _carry_covariance(calibration, wet)
    return replace(wet, covariance=covariance, cover=_set_sigmas(wet, covariance))


def _carry_covariance(calibration: Calibration, wet: Calibration) -> Array:
    """Return the (S, S) covariance of the wet calibration's parameters. It is the original's, and
    the index outside is independent of all other parameters.
    """
    old = calibration.camera_model().parameters
    new = wet.camera_model().parameters
    covariance = np.zeros((new.count, new.count))
    declared_covariance = _widen_to_declared(calibration, old)
    medium_name = wet.cover.medium_name
    common_names = [name for name in new.slices() if name in old.slices() and name != medium_name]
    covariance[np.ix_(new.entries(common_names), new.entries(common_names))] = declared_covariance[
        np.ix_(old.entries(common_names), old.entries(common_names))
    ]
    for param in new.free:
        if param.name == medium_name:
            at = new.entries([param.name])
            covariance[at, at] = (wet.cover.numbers[medium_name].sigma / param.scale) ** 2
    return covariance


def _widen_to_declared(calibration: Calibration, parameters: Parameters) -> Array:
    """Return the (S, S) covariance in which no number of the cover has a smaller sigma than was
    declared. The parameters that correlate with such a number move with it.

    The relief of an uneven glass takes up most of the error of such a number, and the fit takes the
    remainder for information on the number. In the original medium this does no harm: number and
    relief together are right. In another medium their errors no longer cancel
    (`python -m benchmarks.immerse` prints by how much).
    """
    declared = calibration.declared.cover.numbers
    numbers = [
        param
        for param in parameters.free
        if param.name in declared and declared[param.name].sigma > 0
    ]
    covariance = calibration.covariance
    if calibration.relief is None or not numbers:
        return covariance
    at = parameters.entries([param.name for param in numbers])
    by_numbers = regression(covariance, at)
    spread = np.array([declared[param.name].sigma / param.scale for param in numbers]) ** 2
    excess = np.diag(np.maximum(spread - covariance.diagonal()[at], 0.0))
    return np.asarray(covariance + by_numbers @ excess @ by_numbers.T)


def _set_sigmas(wet: Calibration, covariance: Array) -> Cover:
    """Return the cover with the sigma of each estimated number from the (S, S) covariance."""
    parameters = wet.camera_model().parameters
    numbers = wet.cover.numbers
    for param in parameters.free:
        if param.name in numbers:
            numbers[param.name] = replace(
                numbers[param.name],
                sigma=float(parameters.sigma(param.name, torch.from_numpy(covariance))),
            )
    return wet.cover.replace_numbers(numbers)


def _map_jacobian(calibration: Calibration, pixels: Array) -> Array:
    """Return the (N, 4, S) Jacobian of A and B by the parameters; S is 0 without a covariance.

    A and B of a wide lens are taken in frames along the pixels' rays (`frames_along`), because an
    undistorted picture does not hold all its pixels.
    """
    if not calibration.covariance.size:
        return np.zeros((len(pixels), 4, 0))
    wide = calibration.model()[0].lens.wide
    frames = frames_along(calibration.rays(pixels)[1]) if wide else None
    jacobian, invalid = UndistortedChange.of(calibration).jacobian(pixels, frames)
    return np.where(invalid[:, None, None], np.nan, jacobian)


def _other_face_errors(
    calibration: Calibration, wet: Calibration, rows: Array, depths: Sequence[float]
) -> list[float]:
    """Return, for each depth, how much more it matters in the new medium than in the original one
    which face of the glass is uneven: px, root mean square over the corners, less the best rigid
    motion of all rays. An inner face that bends light equally in air is uneven by the same height
    inwards. Return nothing without a relief.
    """
    if wet.relief is None:
        return []
    pixels, depth = rows[:, :2], rows[:, 2]
    path, values = wet.model()
    outer_face, inner_face = calibration.model(), _with_inner_relief(calibration)
    wet_outer_face, wet_inner_face = (path, values), _with_inner_relief(wet)
    _, motions, invalid = undistorted_jacobian(path, Parameters.none(values), pixels)
    valid = ~invalid
    if path.lens.wide:
        valid &= calibration.ray_field().holds(pixels)
        rays = path.trace(torch.from_numpy(pixels), values, MIDDLE)
        depth = depth * rays.direction.z.numpy()

    def difference(metres: Array) -> Array:
        """Return (M, 2) px at (N,) m for the M valid pixels."""
        wet_change = _undistort(*wet_outer_face, pixels, metres) - _undistort(
            *wet_inner_face, pixels, metres
        )
        change = _undistort(*outer_face, pixels, metres) - _undistort(*inner_face, pixels, metres)
        return np.asarray((wet_change - change)[valid])

    columns = (motions[:, 0] + motions[:, 1] / depth[:, None, None])[valid].reshape(-1, 6)
    motion = np.linalg.lstsq(columns, difference(depth).ravel(), rcond=None)[0]
    remainders = (
        difference(np.full(len(pixels), m)) - (motions[:, 0] + motions[:, 1] / m)[valid] @ motion
        for m in depths
    )
    return [float(np.sqrt((remainder**2).sum(-1).mean())) for remainder in remainders]


def _with_inner_relief(calibration: Calibration) -> tuple[Path, Values]:
    """Return the path and its values with the relief on the inner face instead of the outer one."""
    path, values = calibration.model()
    inner, *middle, outer = path.outermost
    cover = (
        *path.cover[: -len(path.outermost)],
        replace(inner, relief=outer.relief, exact_hit=outer.exact_hit),
        *middle,
        replace(outer, relief=None),
    )
    # In air a surface bends light by its glass's index less 1. The first layer may be of another
    # glass than the last one.
    assert outer.index_inside
    gain = (values[outer.index_inside] - 1) / (values[inner.index_outside] - 1)
    return replace(path, cover=cover), {**values, AMPLITUDES: -gain * values[AMPLITUDES]}


def _undistort(path: Path, values: Values, pixels: Array, depth: Array) -> Array:
    """Return the (N, 2) px of the undistorted picture, less its principal point, of (N, 2) px of
    the camera at (N,) m.
    """
    rays = path.trace(torch.from_numpy(pixels), values, MIDDLE)
    origin = rays.origin.stacked().numpy()
    direction = rays.direction.stacked().numpy()
    tangent = direction[:, :2] / direction[:, 2:]
    focal = np.array([float(values[name]) for name in CAMERA.focal])
    return np.asarray(
        focal * (tangent + (origin[:, :2] - tangent * origin[:, 2:]) / depth[:, None])
    )
