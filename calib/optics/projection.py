"""Forward projection: from a point in space to the pixel that sees it, by Newton's method on the
pixel's ray.
"""

import torch
from torch import Tensor

from calib.optics.exposure import Exposure
from calib.optics.lens import PIXELS
from calib.optics.params import Values
from calib.optics.path import Path, Trace
from calib.optics.rotation import Rotation, onto_z

MAX_ITERATIONS = 30
MAX_STEP = 200.0
"""px: from a poor start, several short steps are safer than one long step."""
CONVERGED = 1e-9
"""px"""
CHORD_STEP = 1.0
"""px: after shorter steps of all points, the derivatives stay those of the step before: they change
by a few parts in a thousand at most, so each step is shorter by as much.
"""
MAX_FINAL_STEP = 1e-7
"""px: a longer last step means that no pixel sees the point."""
ANGLE_TOLERANCE = 1e-9
"""rad: the largest angle between a point and the ray of its pixel."""


def project(
    path: Path,
    values: Values,
    points: Tensor,
    exposure: Exposure | None,
    start: Tensor | None = None,
    start_trace: Trace | None = None,
) -> Tensor:
    """Return the pixel whose ray passes through each point.

    Args:
        points: (N, 3) m in the camera frame.
        start: (N, 2) px to start from; without it, the pixel that would see the point if there were
            no cover.
        start_trace: the rays of these pixels with their derivatives, if they are known.

    Returns:
        (N, 2) px; NaN for a point that is not in front of the camera and its cover, or that no ray
        reaches. A wide lens also sees points beside and behind the camera.
    """
    if path.directly_projects:
        return _project_by_lens(path, values, points)
    visible = path.distance(points) > 1e-6
    goal = torch.where(visible.unsqueeze(-1), points, torch.ones_like(points))
    pixels = (path.lens.project(goal, values) if start is None else start).clone()
    frame = Rotation.of(onto_z(goal / goal.norm(dim=-1, keepdim=True))) if path.lens.wide else None
    depth = path.distance(goal)
    target = torch.zeros_like(goal[..., :2]) if frame else goal[..., :2]
    last = torch.full_like(depth, torch.inf)
    jacobian: Tensor | None = None
    for _ in range(MAX_ITERATIONS):
        if jacobian is None or not bool((last[visible] < CHORD_STEP).all()):
            error, jacobian, ahead, failure = _linearised_residual(
                path, values, exposure, pixels, target, depth, frame, start_trace
            )
            start_trace = None
        else:
            rays = path.trace(pixels, values, exposure)
            rays = rays.rotate(frame) if frame else rays
            error, failure = rays.at_depth(depth) - target, rays.failure
            ahead = (depth > rays.origin.z) & (rays.direction.z > 0)
        step = torch.linalg.solve_ex(jacobian, error.unsqueeze(-1)).result.squeeze(-1)
        length = step.norm(dim=-1)
        usable = torch.isfinite(length) & (failure == 0)
        last = torch.where(usable, length, torch.full_like(length, torch.inf))
        short = (MAX_STEP / length.clamp_min(MAX_STEP)).unsqueeze(-1)
        pixels = torch.where(usable.unsqueeze(-1), pixels - short * step, pixels)
        if bool((last[visible & usable] < CONVERGED).all()):
            break
    return torch.where(
        (visible & ahead & (last < MAX_FINAL_STEP)).unsqueeze(-1),
        pixels,
        torch.full_like(pixels, torch.nan),
    )


def _project_by_lens(path: Path, values: Values, points: Tensor) -> Tensor:
    """Return the (N, 2) px where the lens images each point; NaN where the ray of that pixel has
    another direction.
    """
    pixels = path.lens.project(points, values)
    rays = path.lens(pixels, values)
    error = (rays.direction.stacked() - points / points.norm(dim=-1, keepdim=True)).norm(dim=-1)
    return torch.where(
        ((rays.failure == 0) & (error < ANGLE_TOLERANCE)).unsqueeze(-1),
        pixels,
        torch.full_like(pixels, torch.nan),
    )


def _linearised_residual(
    path: Path,
    values: Values,
    exposure: Exposure | None,
    pixels: Tensor,
    goal: Tensor,
    depth: Tensor,
    frame: Rotation | None,
    trace: Trace | None = None,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return the (N, 2) m offset of each pixel's ray from its goal in the plane of the goal's
    depth, its (N, 2, 2) derivative by the pixel, (N) bool, true where the goal lies beyond the
    ray's exit from the cover, and (N) failures. Goal and depth are in the frame of each point, or
    in the camera frame if `frame` is None.
    """
    trace = trace or path.trace_with_derivatives(pixels, values, exposure, frozenset())
    rays = trace.rays.rotate(frame) if frame else trace.rays
    by_rays = rays.at_depth_derivatives(depth)
    by_pixel = trace.pull(by_rays.turned(frame) if frame else by_rays)[PIXELS].transpose(0, 1)
    ahead = (depth > rays.origin.z) & (rays.direction.z > 0)
    return rays.at_depth(depth) - goal, by_pixel, ahead, rays.failure
