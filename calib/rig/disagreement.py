"""The joint estimate of cameras that may disagree on where the board is.

Corners of a rig are as exact as those of each camera alone, so each camera keeps the noise of its
own fit. A cause that this estimate lacks (a late camera, a loose mounting) can leave errors many
times larger. Weighed by that noise, they would override all that is declared: covers and glass
would bend far beyond what any cover is. So the noise of such an estimate is that of its errors.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import torch

from calib.estimation.objective import HUBER
from calib.rig.joint_estimate import RigEstimate, RigState, estimate_rig
from calib.rig.motion_products import NORMAL_MEDIAN

MAX_REPEATS = 5
"""The most estimates with the noise of the one before. For a camera 8 ms late, whose noise was 23
times that of its own fit, five were enough.
"""
SETTLED = 0.1
"""The relative change of the noise below which it is settled: sigmas change by as much."""


def estimate_with_disagreement(
    start: RigState, progress: Callable[[int, float], None] | None = None
) -> RigEstimate:
    """Fit a rig with the noise of each camera's own fit; if half of the corners are then outliers
    of the loss, from the start again, with the noise that the errors have.

    All cameras share the factor of the noise, because the errors do not show which of them errs:
    with factors of their own, one camera soon takes all errors. The glass keeps the smoothness of
    each camera's own fit, whose evidence takes errors for independent: it would choose a texture
    that imitates what all corners of a view have in common.

    Args:
        start: as of `estimate_rig`, with the noise of each camera's own fit.
        progress: as of `estimate_rig`.

    Returns:
        The estimate, with the noise (px) that it used as the `sigma` of its cameras.
    """
    estimate = estimate_rig(start, progress=progress)
    factor = noise_growth(estimate)
    if not factor > HUBER / NORMAL_MEDIAN:  # NaN if the fit is not finite
        return estimate
    for _ in range(MAX_REPEATS):
        noise = {camera.name: factor * camera.sigma for camera in start.cameras}
        wide_start = with_noise(start, noise)
        estimate = estimate_rig(wide_start, fixed_smoothness=True, progress=progress)
        growth = noise_growth(estimate)
        if not abs(growth - 1) > SETTLED:
            break
        factor *= growth
    return estimate


def noise_growth(estimate: RigEstimate) -> float:
    """Return the noise that the median error of all corners has over that of the estimate."""
    lengths = []
    for camera in estimate.problem.cameras:
        poses = camera.compose(estimate.vector, estimate.state.placements)
        residual, lands = camera.landing.residual(estimate.vector[camera.columns], poses)
        lengths.append(residual[lands].norm(dim=-1))
    return float(torch.cat(lengths).median()) / NORMAL_MEDIAN


def with_noise(state: RigState, noise: Mapping[str, float]) -> RigState:
    """Return the state with the noise, px, of each camera by name."""
    cameras = tuple(replace(camera, sigma=noise[camera.name]) for camera in state.cameras)
    return replace(state, cameras=cameras)
