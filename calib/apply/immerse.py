"""A calibration in another medium: made in air, for water, or the other way round. What lies
outside is replaced; all else is the glass's.

The covariance goes with it, so sigma tells what the change of medium makes visible: in air a
window's distance moves no ray, under water every one. Views do not go with it: they were taken in
the other medium. Where their corners were, `Calibration.corners_at` keeps, as sigma leaves out the
rigid motion of all rays that hides most there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.apply.loose import OUTSIDE, UNKNOWN, Loose, loose_numbers, sigmas
from calib.apply.map_uncertainty import UndistortedChange, corners_at, frames_along
from calib.calibration import Calibration
from calib.effects.flat_port import FlatPort
from calib.errors import InputError
from calib.estimation.jacobians import undistorted_jacobian
from calib.estimation.parameters import Parameters
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import AMPLITUDES
from calib.session.cover import Cover
from calib.session.schema import Number

Array = NDArray[np.float64]

DEPTHS = (0.3, 0.5, 1.0)
"""m: where it is said how sure the maps are."""
SAMPLED = 400
"""Corners at which that is asked, of all."""


@dataclass(frozen=True, slots=True, eq=False)
class Immersion:
    """A calibration in its new medium, and how sure it is there: px, root mean square over the
    corners, at each depth.
    """

    calibration: Calibration
    depths: tuple[float, ...]
    """m"""
    before_px: tuple[float, ...]
    """In the medium that it came from; empty where its fit estimated no covariance."""
    after_px: tuple[float, ...]
    loose: tuple[Loose, ...]
    """The groups that are worth naming, the one that matters most first."""
    other_face_px: tuple[float, ...]
    """How far off the maps are, were all unevenness on the glass's inner face; empty without a
    relief.
    """
    unexplained: tuple[str, ...]
    """Effects that mend an error without a physical cause."""

    @property
    def unknown(self) -> bool:
        """Whether the views do not tell what the new medium shows."""
        return any(sigma > UNKNOWN for sigma in self.after_px)


def immerse(
    calibration: Calibration, outside: Number, depths: Sequence[float] = DEPTHS
) -> Immersion:
    """Put a calibration into a medium of another index.

    Raises:
        InputError: nothing is known of what stands before its lens, or no ray leaves it there.
    """
    wet = immersed(calibration, outside)
    rows = corners_at(calibration)
    if not np.isfinite(wet.rays(rows[:, :2])[0]).any():
        raise InputError(
            f"no ray of this camera leaves its cover into an index of {outside.value:g}: check the"
            " cover's numbers."
        )
    some = rows[:: max(1, len(rows) // SAMPLED), :2]
    before, after = (_errors(one, some) for one in (calibration, wet))
    return Immersion(
        wet,
        tuple(depths),
        sigmas(before, calibration.covariance, depths),
        sigmas(after, wet.covariance, depths),
        tuple(loose_numbers(wet, after, depths)),
        tuple(_on_other_face(calibration, wet, rows, depths)),
        tuple(found.effect.name for found in wet.effects if not found.effect.has_cause),
    )


def immersed(calibration: Calibration, outside: Number) -> Calibration:
    """The calibration with another index outside, without its views."""
    if any(isinstance(found.effect, FlatPort) for found in calibration.effects):
        raise InputError(
            "the window of this calibration was found by the diagnosis, and where it stands is not"
            " known in air: describe it under cover in session.yaml, with its distance_mm and"
            " thickness_mm, and fit the session again."
        )
    if OUTSIDE not in calibration.cover.parameters:
        raise InputError(
            "this calibration has no cover, and what water does is done at a window or dome:"
            " describe it under cover in session.yaml, and fit the session again."
        )
    was, declared = calibration.cover.parameters[OUTSIDE], calibration.declared
    wet = replace(
        calibration,
        cover=_within(calibration.cover, outside),
        views=(),
        poses=calibration.poses[:0],
        covariance=calibration.covariance[:0, :0],
        rejected=(),
        stages=(),
        corners_at=corners_at(calibration),
        stated=replace(declared, cover=_within(declared.cover, outside)),
        settings={
            **calibration.settings,
            "immersed": {
                "from_index": was.value,
                "to_index": outside.value,
                "sigma": outside.sigma,
                "calibration": calibration.digest,
            },
        },
    )
    if not calibration.covariance.size:
        return wet
    covariance = _carried(calibration, wet)
    return replace(wet, covariance=covariance, cover=_with_sigmas(wet, covariance))


def _within(cover: Cover, outside: Number) -> Cover:
    return replace(cover, parameters={**cover.parameters, OUTSIDE: outside})


def _carried(calibration: Calibration, wet: Calibration) -> Array:
    """(S, S) of the wet calibration's parameters: as they were before, and independent of them what
    is outside.
    """
    old, new = calibration.camera_model().parameters, wet.camera_model().parameters
    covariance, before = np.zeros((new.count, new.count)), _as_declared(calibration, old)
    known = [name for name in new.slices() if name in old.slices() and name != f"cover.{OUTSIDE}"]
    covariance[np.ix_(new.entries(known), new.entries(known))] = before[
        np.ix_(old.entries(known), old.entries(known))
    ]
    for param in new.free:
        if param.name == f"cover.{OUTSIDE}":
            at = new.entries([param.name])
            covariance[at, at] = (wet.cover.parameters[OUTSIDE].sigma / param.scale) ** 2
    return covariance


def _as_declared(calibration: Calibration, parameters: Parameters) -> Array:
    """(S, S) covariance in which no number of the cover is surer than it was declared, what depends
    on it moving along.

    An uneven glass takes up most of what such a number is off by. What is left, the fit takes for
    knowledge of the number, and in its own
    medium that does no harm: the two together are right. In another they part (`python -m
        benchmarks.immerse` prints by how much).
    """
    declared = {
        f"cover.{name}": number.sigma
        for name, number in calibration.declared.cover.parameters.items()
    }
    numbers = [param for param in parameters.free if declared.get(param.name, 0.0) > 0]
    covariance = calibration.covariance
    if calibration.relief is None or not numbers:
        return covariance
    at = parameters.entries([param.name for param in numbers])
    own = covariance[np.ix_(at, at)]
    along = covariance[:, at] @ np.linalg.pinv(
        own, hermitian=True
    )  # (S, n) how all move with these
    spread = np.array([declared[param.name] / param.scale for param in numbers]) ** 2
    wider = np.diag(np.maximum(spread - own.diagonal(), 0.0))
    return np.asarray(covariance + along @ wider @ along.T)


def _with_sigmas(wet: Calibration, covariance: Array) -> Cover:
    """Its cover, each estimated number as sure as the covariance has it."""
    parameters = wet.camera_model().parameters
    found = dict(wet.cover.parameters)
    for param in parameters.free:
        if (name := param.name.removeprefix("cover.")) in found:
            found[name] = replace(
                found[name], sigma=float(parameters.sigma(param.name, torch.from_numpy(covariance)))
            )
    return replace(wet.cover, parameters=found)


def _errors(calibration: Calibration, pixels: Array) -> Array:
    """Return the (N, 4, S) Jacobian of A and B by the parameters; S is 0 without a covariance.

    A and B of a wide lens are taken in frames along the pixels' rays (`frames_along`), because an
    undistorted picture does not hold all its pixels.
    """
    if not calibration.covariance.size:
        return np.zeros((len(pixels), 4, 0))
    wide = calibration.model()[0].lens.wide
    frames = frames_along(calibration.rays(pixels)[1]) if wide else None
    jacobian, lost = UndistortedChange.of(calibration).jacobian(pixels, frames)
    return np.where(lost[:, None, None], np.nan, jacobian)


def _on_other_face(
    calibration: Calibration, wet: Calibration, rows: Array, depths: Sequence[float]
) -> list[float]:
    """px by depth, root mean square: how much more than in the first medium it matters which face
    of the glass is uneven, the best rigid motion of all rays taken off. An inner face that bends
    light as much in air is uneven by the same height inwards.
    """
    if wet.relief is None:
        return []
    pixels, depth = rows[:, :2], rows[:, 2]
    (near, far), (wet_near, wet_far) = ((one.model(), _moved(one)) for one in (calibration, wet))
    path, values = wet_near
    _, motions, lost = undistorted_jacobian(path, Parameters.none(values), pixels)
    kept = ~lost
    if path.lens.wide:
        kept &= calibration.ray_field().holds(pixels)
        depth = depth * path.trace(torch.from_numpy(pixels), values).direction.z.numpy()

    def off(at: Array) -> Array:
        (a, b), (c, d) = (
            (_seen(*one, pixels, at), _seen(*other, pixels, at))
            for one, other in ((near, far), (wet_near, wet_far))
        )
        return np.asarray(((c - d) - (a - b))[kept])

    columns = (motions[:, 0] + motions[:, 1] / depth[:, None, None])[kept].reshape(-1, 6)
    motion = np.linalg.lstsq(columns, off(depth).ravel(), rcond=None)[0]
    left = (
        off(np.full(len(pixels), m)) - (motions[:, 0] + motions[:, 1] / m)[kept] @ motion
        for m in depths
    )
    return [float(np.sqrt((one**2).sum(-1).mean())) for one in left]


def _moved(calibration: Calibration) -> tuple[Path, Values]:
    """The path with its relief on the inner face."""
    path, values = calibration.model()
    inner, outer = path.cover
    cover = (
        replace(inner, relief=outer.relief, exact_hit=outer.exact_hit),
        replace(outer, relief=None),
    )
    return replace(path, cover=cover), {**values, AMPLITUDES: -values[AMPLITUDES]}


def _seen(path: Path, values: Values, pixels: Array, depth: Array) -> Array:
    """(N, 2) px of the undistorted picture, less its principal point, at (N,) m."""
    rays = path.trace(torch.from_numpy(pixels), values)
    origin, direction = (vector.stacked().numpy() for vector in (rays.origin, rays.direction))
    tangent = direction[:, :2] / direction[:, 2:]
    focal = np.array([float(values[f"camera.{name}"]) for name in ("fx", "fy")])
    return np.asarray(
        focal * (tangent + (origin[:, :2] - tangent * origin[:, 2:]) / depth[:, None])
    )
