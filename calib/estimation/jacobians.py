"""The Jacobian of a pixel's undistorted position A + B / Z (`undistortion.ray_field`), by a fit's
shared parameters and by a rigid motion of all rays. That motion is the gauge freedom of board views
with unknown poses.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.parameters import Parameters
from calib.estimation.probes import ProbedValues, TracedRows
from calib.optics.params import Values
from calib.optics.path import Path, row_derivatives
from calib.optics.rays import Rays
from calib.optics.vector import Vector

Array = NDArray[np.float64]


def undistorted_jacobian(
    path: Path, parameters: Parameters, pixels: Array
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the Jacobians of A, in px, and of B, in px m, at (N, 2) px and at the parameters'
    origin.

    Returns:
        (N, 2, 2, S) derivatives of A and B, x and y each, by the vector of the shared parameters;
        (N, 2, 2, 6) derivatives by a small rotation (rad) and translation (m) of all rays; (N,)
        true where there is no ray.
    """
    rows, points, values = len(pixels), torch.from_numpy(pixels), parameters.origin
    probed = ProbedValues.of(path, parameters, values, rows, path.adjustments)
    motion = torch.zeros(rows, 6, dtype=torch.float64, requires_grad=True)
    with torch.enable_grad():
        rays = path.trace(points, probed.values)
        by_motion, *by_leaves = row_derivatives(
            _undistorted(rays, motion, values), [motion, *probed.leaves.values()]
        )
    traced = TracedRows(points, rays, values, path.linear_terms(points, values))
    columns = probed.columns(by_leaves, traced)
    by_shared = by_motion[..., :0] if columns is None else columns
    jacobian = by_shared.reshape(rows, 2, 2, by_shared.shape[-1]).numpy()
    by_rigid = by_motion.reshape(rows, 2, 2, by_motion.shape[-1]).numpy()
    return jacobian, by_rigid, (rays.failure != 0).numpy()


def _undistorted(rays: Rays, motion: Tensor, values: Values) -> Tensor:
    """Return (N, 4): A, minus the principal point, and B, of rays after a small motion.

    The pinhole of the undistorted picture does not change.
    """
    turn, shift = Vector.of(motion[:, :3]), Vector.of(motion[:, 3:])
    direction = rays.direction + turn.cross(rays.direction)
    origin = rays.origin + turn.cross(rays.origin) + shift
    fx = float(values["camera.fx"])
    fy = float(values["camera.fy"])
    tan_x, tan_y = direction.x / direction.z, direction.y / direction.z
    return torch.stack(
        [
            fx * tan_x,
            fy * tan_y,
            fx * (origin.x - tan_x * origin.z),
            fy * (origin.y - tan_y * origin.z),
        ],
        -1,
    )
