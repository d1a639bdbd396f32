"""The Jacobian of a pixel's undistorted position A + B / Z (`undistortion.ray_field`), by a fit's shared parameters and by a rigid motion
of all rays: that motion is the gauge, which board views with unknown poses leave open.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.parameters import Parameters
from calib.estimation.residual_blocks import joined
from calib.optics.params import Values
from calib.optics.path import Path, by_row
from calib.optics.rays import Rays
from calib.optics.relief import PROBES
from calib.optics.vector import Vector

Array = NDArray[np.float64]


def undistorted_jacobian(path: Path, parameters: Parameters, pixels: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """The Jacobian of A, in px, and of B, in px m, at (N, 2) px and at the parameters' origin.

    Returns:
        (N, 2, 2, S) of A and B, x and y each, by the shared parameters' vector; (N, 2, 2, 6) by a small rotation (rad) and translation (m)
        of all rays; (N,) where there is no ray.
    """
    rows, at, values = len(pixels), torch.from_numpy(pixels), parameters.origin
    names = [param.name for param in parameters.free]
    free = [values[name].expand(rows, *values[name].shape).clone().requires_grad_() for name in names]
    probes = [torch.zeros(rows, dtype=torch.float64, requires_grad=True) for _ in PROBES] if parameters.relief else []
    motion = torch.zeros(rows, 6, dtype=torch.float64, requires_grad=True)
    probed = {**values, **dict(zip(names, free, strict=True)), **dict(zip(PROBES, probes, strict=False))}
    with torch.enable_grad():
        rays = path.trace(at, probed)
        by_motion, *rest = by_row(_undistorted(rays, motion, values), [motion, *probes, *free])
    by_probe, by_free = rest[: len(probes)], rest[len(probes) :]
    columns = [joined(by_free) * parameters.scales] if free else []
    if parameters.relief:
        outer = path.cover[-1]
        _, adjusted = path.adjusted(at, values)
        where = outer.surface.chart(outer.frame.enter(rays.origin.detach(), adjusted))
        columns.insert(0, parameters.relief.spread(torch.stack(by_probe, -1), where))
    by_shared = torch.cat(columns, -1) if columns else by_motion[..., :0]
    jacobian, by_rigid = (part.reshape(rows, 2, 2, part.shape[-1]).numpy() for part in (by_shared, by_motion))
    return jacobian, by_rigid, (rays.failure != 0).numpy()


def _undistorted(rays: Rays, motion: Tensor, values: Values) -> Tensor:
    """(N, 4) A, less the principal point, and B of rays after a small motion. The picture's own pinhole is held."""
    turn, shift = Vector.of(motion[:, :3]), Vector.of(motion[:, 3:])
    direction = rays.direction + turn.cross(rays.direction)
    origin = rays.origin + turn.cross(rays.origin) + shift
    fx, fy = (float(values[f"camera.{name}"]) for name in ("fx", "fy"))
    across, down = direction.x / direction.z, direction.y / direction.z
    return torch.stack([fx * across, fy * down, fx * (origin.x - across * origin.z), fy * (origin.y - down * origin.z)], -1)
