"""The joint fit of a rig whose board bends differently in every placement.

All cameras see the same bend, so it belongs to the placement, and is eliminated with its pose. As
in every fit of a rig, the noise of a camera is that of its own fit, so that a cause by which
cameras disagree is not taken for noise. Without the bends it was the error of the board, so each
camera is fitted by itself again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from torch import Tensor

from calib.checking.prior import MIN_NOISE
from calib.effects.board_flex import BoardFlex
from calib.effects.effect import BLOCK_SCALES
from calib.estimation.joint_fit import ROUNDS, Start
from calib.estimation.poses import refine_poses_in_image
from calib.estimation.residuals import residuals
from calib.rig.disagreement import SETTLED, with_noise
from calib.rig.explanation_fit import FittedExplanation
from calib.rig.joint_estimate import CameraState, RigEstimate, RigState, estimate_rig
from calib.rig.own_effects import with_effects
from calib.rig.shared_cover import MountedLens

MAX_REPEATS = 5
"""The most joint fits with the noise of the one before."""
NOISE_STEPS = 3
"""The steps in which the noise of one camera and the poses of its views settle."""


@dataclass(frozen=True, slots=True, eq=False)
class BentFit:
    """A joint fit with a bend of the board in each placement."""

    estimate: RigEstimate
    alone_px: Mapping[str, float]
    """px, for each camera: the error of its views with a pose and a bend of their own."""


@dataclass(frozen=True, slots=True)
class CameraNoise:
    """The errors of one camera by itself, with a pose and a bend in each of its views."""

    sigma: float
    """The noise of a corner, px per axis."""
    rms_px: float
    """The root mean square two-dimensional error."""


def fit_with_bends(state: RigState, fitted: FittedExplanation, effect: BoardFlex) -> BentFit:
    """Fit a rig with a bend of the board in each placement.

    Args:
        state: the optimum without bends.
        fitted: the explanation, with the size of the bends.
        effect: in the largest plausible size.
    """
    size = float(fitted.sizes[0])
    nearest = min(BLOCK_SCALES, key=lambda scale: abs(math.log(scale / size)))
    sized = replace(effect, size=nearest)
    state = with_effects(state, [(sized,)] * len(state.cameras)).state
    noise: dict[str, CameraNoise] = {}
    for repeat in range(MAX_REPEATS):
        noise |= {
            camera.name: _noise_of_views(camera, poses) if mounted else _noise_alone(camera, poses)
            for camera, poses, mounted in _cameras(state)
            if mounted or not repeat
        }
        changes = [noise[camera.name].sigma / camera.sigma - 1 for camera in state.cameras]
        if repeat and max(map(abs, changes)) < SETTLED:
            break
        estimate = estimate_rig(with_noise(state, {n: errors.sigma for n, errors in noise.items()}))
        state = estimate.state
    return BentFit(estimate, {name: errors.rms_px for name, errors in noise.items()})


def _cameras(state: RigState) -> Iterator[tuple[CameraState, Tensor, bool]]:
    """Yield each camera, its (V, B) poses and bends, and true for one behind another's cover."""
    for index, camera in enumerate(state.cameras):
        is_mounted = isinstance(camera.model.path.lens, MountedLens)
        yield camera, state.poses(index), is_mounted


def _noise_alone(camera: CameraState, poses: Tensor) -> CameraNoise:
    """Fit a camera by itself, from a start in the rig."""
    start = Start(camera.values, camera.sigma, camera.smoothness)
    joint = camera.model.fit(camera.observations, poses, start, ROUNDS)
    if not joint.finite:
        return _noise_of_views(camera, poses)
    residual = residuals(camera.model.path, joint.values, camera.observations, joint.poses)
    return CameraNoise(max(joint.sigma, MIN_NOISE), residual.rms_px)


def _noise_of_views(camera: CameraState, poses: Tensor) -> CameraNoise:
    """Fit the views of a camera by themselves, without a change of the camera: its views alone do
    not tell where it stands behind another camera's cover.
    """
    path, values, observations = camera.model.path, camera.values, camera.observations
    freedom = max(2 * len(observations.pixels) - poses.numel(), 1)
    sigma = camera.sigma
    for _ in range(NOISE_STEPS):
        solution = refine_poses_in_image(path, values, observations, poses, sigma=sigma)
        poses = solution.blocks
        sigma *= math.sqrt(solution.equations.sum_of_squares / freedom)
    residual = residuals(path, values, observations, poses)
    return CameraNoise(max(sigma, MIN_NOISE), residual.rms_px)
