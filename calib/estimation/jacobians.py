"""The Jacobian of a pixel's undistorted position A + B / Z (`undistortion.ray_field`), by a fit's
shared parameters and by a rigid motion
of all rays: that motion is the gauge, which board views with unknown poses leave open.
"""

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.parameters import Parameters
from calib.estimation.probed import Probed, Seen
from calib.optics.params import Values
from calib.optics.path import Path, by_row
from calib.optics.rays import Rays
from calib.optics.rotation import Rotation
from calib.optics.vector import Vector

Array = NDArray[np.float64]


def undistorted_jacobian(
    path: Path, parameters: Parameters, pixels: Array, frames: Array | None = None
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """The Jacobian of A, in px, and of B, in px m, at (N, 2) px and at the parameters' origin.

    Args:
        frames: (N, 3, 3) rotations from the camera frame to the frame of each pixel, in which its A
            and B are taken, as if the camera looked in that direction. In such a frame, even a ray
            beside or behind the camera has A and B. None for the camera frame.

    Returns:
        (N, 2, 2, S) of A and B, x and y each, by the shared parameters' vector; (N, 2, 2, 6) by a
        small rotation (rad) and translation (m) of all rays; (N,), true where there is no ray or
        it does not go forward.
    """
    rows, at, values = len(pixels), torch.from_numpy(pixels), parameters.origin
    probed = Probed.of(path, parameters, values, rows, path.adjustments)
    frame = None if frames is None else Rotation.of(torch.from_numpy(frames))
    motion = torch.zeros(rows, 6, dtype=torch.float64, requires_grad=True)
    with torch.enable_grad():
        rays = path.trace(at, probed.values)
        by_motion, *rest = by_row(
            _undistorted(rays, motion, values, frame), [motion, *probed.leaves.values()]
        )
        valid = _in_frame(frame, rays).in_pinhole
    columns = probed.columns(rest, Seen(at, rays, values, path.linear_parts(at, values)))
    by_shared = by_motion[..., :0] if columns is None else columns
    jacobian, by_rigid = (
        part.reshape(rows, 2, 2, part.shape[-1]).numpy() for part in (by_shared, by_motion)
    )
    return jacobian, by_rigid, (~valid).numpy()


def _undistorted(rays: Rays, motion: Tensor, values: Values, frame: Rotation | None) -> Tensor:
    """(N, 4) A, less the principal point, and B of rays after a small motion.

    The picture's own pinhole is held.
    """
    turn, shift = Vector.of(motion[:, :3]), Vector.of(motion[:, 3:])
    direction = rays.direction + turn.cross(rays.direction)
    origin = rays.origin + turn.cross(rays.origin) + shift
    rays = _in_frame(frame, Rays(origin, direction, rays.failure))
    origin, direction = rays.origin, rays.direction
    forward = torch.where(rays.in_pinhole, direction.z, torch.ones_like(direction.z))
    fx, fy = (float(values[f"camera.{name}"]) for name in ("fx", "fy"))
    across, down = direction.x / forward, direction.y / forward
    return torch.stack(
        [
            fx * across,
            fy * down,
            fx * (origin.x - across * origin.z),
            fy * (origin.y - down * origin.z),
        ],
        -1,
    )


def _in_frame(frame: Rotation | None, rays: Rays) -> Rays:
    return rays.rotate(frame) if frame else rays
