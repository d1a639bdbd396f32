"""The Jacobian of a pixel's undistorted position A + B / Z (`undistortion.ray_field`), by a fit's
shared parameters and by a rigid motion of all rays. That motion is the gauge freedom of board views
with unknown poses.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.parameters import Parameters
from calib.estimation.probes import shared_columns
from calib.optics.derivatives import ByRay, by_autograd
from calib.optics.exposure import MIDDLE
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.rays import Rays
from calib.optics.rotation import Rotation
from calib.optics.vector import Vector
from calib.session.parameter_names import CAMERA

Array = NDArray[np.float64]

RAY = tuple(f"{vector}.{axis}" for vector in ("origin", "direction") for axis in "xyz")
MOTION = "motion"


def undistorted_jacobian(
    path: Path, parameters: Parameters, pixels: Array, frames: Array | None = None
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return the Jacobians of A, in px, and of B, in px m, at (N, 2) px and at the parameters'
    origin.

    Args:
        frames: (N, 3, 3) rotations from the camera frame to the frame of each pixel, in which its A
            and B are taken, as if the camera looked in that direction. In such a frame, even a ray
            beside or behind the camera has A and B. None for the camera frame.

    Returns:
        (N, 2, 2, S) derivatives of A and B, x and y each, by the vector of the shared parameters;
        (N, 2, 2, 6) derivatives by a small rotation (rad) and translation (m) of all rays; (N,)
        true where there is no ray, or where it does not go forward.
    """
    points, values = torch.from_numpy(pixels), parameters.origin
    names = frozenset(parameters.slices())
    frame = None if frames is None else Rotation.of(torch.from_numpy(frames))
    trace = path.trace_with_derivatives(points, values, MIDDLE, names)
    rays = trace.rays
    origin, direction = rays.origin, rays.direction
    zero = torch.zeros_like(direction.x)
    components = (origin.x, origin.y, origin.z, direction.x, direction.y, direction.z)
    copies = {name: value + zero for name, value in zip(RAY, components, strict=True)}

    def undistorted(leaves: Values) -> list[Tensor]:
        values_of_ray = [leaves[name] for name in RAY]
        moved = Rays(Vector(*values_of_ray[:3]), Vector(*values_of_ray[3:]), rays.failure)
        return list(_undistorted(moved, leaves[MOTION], values, frame).unbind(-1))

    outputs, pull_undistorted = by_autograd(
        undistorted, {**copies, MOTION: points.new_zeros(len(points), 6)}
    )
    by = pull_undistorted(list(torch.eye(4).to(points).unsqueeze(-1).expand(4, 4, len(points))))
    by_rays = ByRay(Vector(*(by[n] for n in RAY[:3])), Vector(*(by[n] for n in RAY[3:])))
    terms = path.linear_terms(points, values, MIDDLE)
    columns = shared_columns(path, parameters, trace.pull(by_rays), trace, terms, len(outputs))
    jacobian = columns.reshape(len(points), 2, 2, parameters.count).numpy()
    by_rigid = by[MOTION].transpose(0, 1).reshape(len(points), 2, 2, 6).numpy()
    return jacobian, by_rigid, (~_in_frame(frame, rays).in_pinhole).numpy()


def _undistorted(rays: Rays, motion: Tensor, values: Values, frame: Rotation | None) -> Tensor:
    """Return (N, 4): A, minus the principal point, and B, of rays after a small motion.

    The pinhole of the undistorted picture does not change.
    """
    turn, shift = Vector.of(motion[:, :3]), Vector.of(motion[:, 3:])
    direction = rays.direction + turn.cross(rays.direction)
    origin = rays.origin + turn.cross(rays.origin) + shift
    rays = _in_frame(frame, Rays(origin, direction, rays.failure))
    origin, direction = rays.origin, rays.direction
    forward = torch.where(rays.in_pinhole, direction.z, torch.ones_like(direction.z))
    fx = float(values[CAMERA.fx])
    fy = float(values[CAMERA.fy])
    tan_x = direction.x / forward
    tan_y = direction.y / forward
    return torch.stack(
        [
            fx * tan_x,
            fy * tan_y,
            fx * (origin.x - tan_x * origin.z),
            fy * (origin.y - tan_y * origin.z),
        ],
        -1,
    )


def _in_frame(frame: Rotation | None, rays: Rays) -> Rays:
    return rays.rotate(frame) if frame else rays
