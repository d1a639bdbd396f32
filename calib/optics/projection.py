"""Forward projection: from a point in space to the pixel that sees it, by Newton's method on the
rays.
"""

import torch
from torch import Tensor

from calib.optics.params import Values
from calib.optics.path import Path, by_row
from calib.optics.rotation import Rotation, onto_z

STEPS = 30
LONGEST_STEP = 200.0
"""px: where a start is poor, several short steps are safer than one long one."""
CONVERGED = 1e-9
"""px"""
ACCEPTED = 1e-7
"""px: the last step of a pixel that counts as found."""
SAME = 1e-9
"""rad: between a point and the ray of its pixel."""


def project(path: Path, values: Values, points: Tensor, start: Tensor | None = None) -> Tensor:
    """The pixel whose ray passes through each point.

    Args:
        points: (N, 3) m in the camera frame.
        start: (N, 2) px to start from; without it, the pixel that would see the point if there were
            no cover.

    Returns:
        (N, 2) px; NaN for a point that is not in front of the camera and its cover, or that no ray
        reaches. A wide lens sees what is beside and behind it, too.
    """
    if path.directly_projects:
        return _by_lens(path, values, points)
    visible = path.distance(points) > 1e-6
    goal = torch.where(visible.unsqueeze(-1), points, torch.ones_like(points))
    pixels = (path.lens.project(goal, values) if start is None else start).clone()
    frame = Rotation.of(onto_z(goal / goal.norm(dim=-1, keepdim=True))) if path.lens.wide else None
    depth = path.distance(goal)
    target = torch.zeros_like(goal[..., :2]) if frame else goal[..., :2]
    last = torch.full_like(depth, torch.inf)
    for _ in range(STEPS):
        error, jacobian, ahead, failure = _miss(path, values, pixels, target, depth, frame)
        step = torch.linalg.solve_ex(jacobian, error.unsqueeze(-1)).result.squeeze(-1)
        length = step.norm(dim=-1)
        usable = torch.isfinite(length) & (failure == 0)
        last = torch.where(usable, length, torch.full_like(length, torch.inf))
        short = (LONGEST_STEP / length.clamp_min(LONGEST_STEP)).unsqueeze(-1)
        pixels = torch.where(usable.unsqueeze(-1), pixels - short * step, pixels)
        if bool((last[visible & usable] < CONVERGED).all()):
            break
    return torch.where(
        (visible & ahead & (last < ACCEPTED)).unsqueeze(-1),
        pixels,
        torch.full_like(pixels, torch.nan),
    )


def _by_lens(path: Path, values: Values, points: Tensor) -> Tensor:
    """(N, 2) px where the lens images each point, NaN where it sees another direction there."""
    pixels = path.lens.project(points, values)
    rays = path.lens(pixels, values)
    off = (rays.direction.stacked() - points / points.norm(dim=-1, keepdim=True)).norm(dim=-1)
    return torch.where(
        ((rays.failure == 0) & (off < SAME)).unsqueeze(-1),
        pixels,
        torch.full_like(pixels, torch.nan),
    )


def _miss(
    path: Path,
    values: Values,
    pixels: Tensor,
    goal: Tensor,
    depth: Tensor,
    frame: Rotation | None,
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """By how much (N, 2) m each pixel's ray passes the goal in the plane of its depth, the (N, 2,
    2) derivative, (N) bool whether the goal lies beyond the ray's exit from the cover, (N)
    failures. Goal and depth are in the frame of each point, or in the camera frame if it is None.
    """
    with torch.enable_grad():
        at = pixels.detach().requires_grad_()
        rays = path.trace(at, values)
        rays = rays.rotate(frame) if frame else rays
        error = rays.at_depth(depth) - goal
        (jacobian,) = by_row(error, [at])
    ahead = (depth > rays.origin.z) & (rays.direction.z > 0)
    return error.detach(), jacobian, ahead.detach(), rays.failure
