"""Comparison with what the renderer knows: its rays, up to the rigid motion that board views leave open."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from calib.apply.map_uncertainty import predicted_sigma
from calib.calibration import Calibration
from calib.corners.view import View

FIXTURES = Path(__file__).parent.parent / "fixtures"
DEPTHS = (0.3, 0.5, 1.0)
"""m"""

Array = NDArray[np.float64]


@dataclass(frozen=True)
class MapError:
    """RMS px at each depth between a calibration's rays, moved rigidly, and the true ones."""

    by_depth: dict[float, float]
    predicted: dict[float, float]
    """RMS px that the calibration expects there; empty where it estimated none."""
    pixels: int


def map_error(calibration: Calibration, truth: Path, near: float, depths: tuple[float, ...] = DEPTHS) -> MapError:
    """Compare where at least three training corners lie within `near` px."""
    with np.load(truth) as file:
        pixels, origins, directions = (file[name] for name in ("pixels", "origins", "directions"))
    corners = np.concatenate([view.corners[view.seen] for view in calibration.views])
    third = np.asarray(cKDTree(corners).query(pixels, k=3)[0])[:, 2]
    kept = (third <= near) & np.isfinite(origins).all(-1)
    ours = calibration.rays(pixels[kept])
    assert np.isfinite(ours[0]).all()
    assert calibration.camera.intrinsics
    focal = calibration.camera.intrinsics.fx.value
    goals = [_at(origins[kept], directions[kept], depth) for depth in depths]

    def off(motion: Array) -> Array:
        turn = Rotation.from_rotvec(motion[:3])
        moved = turn.apply(ours[0]) + motion[3:], turn.apply(ours[1])
        return np.stack([(_at(*moved, depth) - goal) * focal / depth for depth, goal in zip(depths, goals, strict=True)])

    def flat(motion: Array) -> Array:
        return off(motion).ravel()

    best = least_squares(flat, np.zeros(6), x_scale=[1e-3] * 3 + [1e-4] * 3)
    squared = (off(best.x) ** 2).sum(-1).mean(-1)
    field, (x, y) = predicted_sigma(calibration), pixels[kept].T[:, :, None]
    predicted = {depth: float(np.sqrt(np.mean(field.at(x, y, depth) ** 2))) for depth in depths} if field else {}
    return MapError({depth: float(value**0.5) for depth, value in zip(depths, squared, strict=True)}, predicted, int(kept.sum()))


def detected_off(views: Sequence[View], true: Array) -> Array:
    """(V * corners, 2) px, detected corners minus the (V, corners, 2) true ones; a board turned by 180 degrees looks the same."""
    assert len(views) == len(true)
    either = [(view.corners - own, view.corners - own[::-1]) for view, own in zip(views, true, strict=True)]
    return np.concatenate([min(pair, key=lambda error: float(np.abs(error).max())) for pair in either])


def _at(origins: Array, directions: Array, depth: float) -> Array:
    """(N, 2) m where rays pass the plane z = depth."""
    along = (depth - origins[:, 2]) / directions[:, 2]
    return np.asarray(origins[:, :2] + along[:, None] * directions[:, :2])
