"""How the undistorted position A + B / Z of a pixel changes with what a fit estimates, and with a rigid motion of all rays."""

from collections.abc import Mapping

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.residual_blocks import joined
from calib.optics.params import Values
from calib.optics.path import Path, by_row
from calib.optics.rays import Rays
from calib.optics.relief import PROBES
from calib.optics.vector import Vector

Array = NDArray[np.float64]


def undistorted_slopes(path: Path, values: Values, scales: Mapping[str, float], pixels: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Derivatives at (N, 2) px, A in px and B in px m, by the path's relief, if it has one, and by the numbers that `scales` names.

    Returns:
        (N, 2, 2, S) of A and B, x and y each, by the amplitudes (m) and the numbers over their scales; (N, 2, 2, 6) by a small rotation
        (rad) and translation (m) of all rays; (N,) where there is no ray.
    """
    rows, at = len(pixels), torch.from_numpy(pixels)
    outer = path.cover[-1] if path.cover and path.cover[-1].relief else None
    numbers = [values[name].expand(rows, *values[name].shape).clone().requires_grad_() for name in scales]
    probes = [torch.zeros(rows, dtype=torch.float64, requires_grad=True) for _ in PROBES] if outer else []
    motion = torch.zeros(rows, 6, dtype=torch.float64, requires_grad=True)
    probed = {**values, **dict(zip(scales, numbers, strict=True)), **dict(zip(PROBES, probes, strict=False))}
    with torch.enable_grad():
        rays = path.trace(at, probed)
        by_motion, *rest = by_row(_undistorted(rays, motion, values), [motion, *probes, *numbers])
    columns = [joined([slope]) * scale for slope, scale in zip(rest[len(probes) :], scales.values(), strict=True)]
    if outer and outer.relief:
        _, adjusted = path.adjusted(at, values)
        where = outer.surface.chart(outer.frame.enter(rays.origin.detach(), adjusted))
        columns.insert(0, outer.relief.spread(torch.stack(rest[: len(probes)], -1), where))
    by_shared, by_rigid = (slopes.reshape(rows, 2, 2, slopes.shape[-1]).numpy() for slopes in (torch.cat(columns, -1), by_motion))
    return by_shared, by_rigid, (rays.failure != 0).numpy()


def _undistorted(rays: Rays, motion: Tensor, values: Values) -> Tensor:
    """(N, 4) A, less the principal point, and B of rays after a small motion. The picture's own pinhole is held."""
    turn, shift = Vector.of(motion[:, :3]), Vector.of(motion[:, 3:])
    direction = rays.direction + turn.cross(rays.direction)
    origin = rays.origin + turn.cross(rays.origin) + shift
    fx, fy = (float(values[f"camera.{name}"]) for name in ("fx", "fy"))
    across, down = direction.x / direction.z, direction.y / direction.z
    return torch.stack([fx * across, fy * down, fx * (origin.x - across * origin.z), fy * (origin.y - down * origin.z)], -1)
