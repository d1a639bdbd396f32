"""The stages of a fit, each of which extends the previous one: the pinhole, the smooth cover, and
the cover's relief.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.calibration import Stage
from calib.effects.effect import Effect
from calib.errors import NotEnoughDataError
from calib.estimation.camera_model import CameraModel
from calib.estimation.gradient_fit import descend
from calib.estimation.joint_fit import (
    FIRST_SIGMA,
    GOOD_GLASS,
    ROUGH_ROUNDS,
    ROUNDS,
    JointFit,
    Start,
    fit_joint,
)
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import Residuals, residuals
from calib.estimation.stated_priors import priors_of
from calib.estimation.surface_prior import expected_amplitudes
from calib.fit_record.request import Settings
from calib.fitting.board_turns import find_turned
from calib.fitting.fit_result import EFFECTS_STAGE
from calib.inference.board_bend import estimate_bend
from calib.optics.build import covered_path, footprint, pinhole_path, with_relief
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import AMPLITUDES, Relief
from calib.progress import Progress
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.freeing import AUTO, free_parameters

MAX_LOST_FRACTION = 0.2
"""If the rays of a larger fraction of corners fail, the described cover cannot be right."""
LINEARISATIONS = 12
"""Length of the progress bar: a joint fit takes about as many."""


@dataclass(frozen=True, slots=True)
class Setup:
    """The board, camera and cover as they are known before the fit."""

    board: Board
    camera: Camera
    intrinsics: Intrinsics
    cover: Cover
    intrinsics_are_final: bool = False
    """True if no joint fit must estimate these intrinsics again (`FitInputs`)."""

    def with_tolerances(self, settings: Settings) -> Setup:
        """Return the setup with a tolerance for each declared number that the settings estimate.

        Raises:
            InputError: the cover has no number of such a name.
        """
        if settings.method == "paper":
            return self
        names = settings.free
        if self.cover.shape == "none":  # stated intrinsics are held unless they have a tolerance
            names = tuple(name for name in names if name != AUTO)
        intrinsics, cover = free_parameters(self.intrinsics, self.cover, names)
        return replace(self, intrinsics=intrinsics, cover=cover)


@dataclass(frozen=True, slots=True)
class Fitted:
    """The model, poses and residuals after the last stage."""

    path: Path
    values: Values
    poses: Tensor
    stages: tuple[Stage, ...]
    residuals: Residuals
    relief: Relief | None = None
    joint: JointFit | None = None
    model: CameraModel | None = None
    """The model of the joint fit; None without one."""
    turned: tuple[str, ...] = ()
    """The views that show the board turned by a quarter turn. This fit has them as they are."""

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects of the path: the board's bend, or none."""
        return self.model.effects if self.model else ()


def fit_stages(
    setup: Setup,
    observations: Observations,
    settings: Settings,
    progress: Progress,
    *,
    earlier: Fitted | None = None,
    labels: NDArray[np.int64] | None = None,
    bend: tuple[Effect, ...] | None = None,
    purpose: str = "",
) -> Fitted:
    """Fit the model to corners, stage by stage. The joint method also estimates the numbers of the
    setup that have a standard deviation.

    Args:
        earlier: a fit of the same setup and views to other corners, from which the last stage
            starts.
        labels: (V,) labels of the board's poses, as `calib.corners.view.pose_labels` gives them;
            None if each view has a pose of its own.
        bend: the effects of an earlier fit of these views, which decided on the board's bend; None
            to decide.
        purpose: a few words for the progress bar that distinguish this fit from others of the
            session.

    Raises:
        InputError: no ray of the camera leaves the cover.
        NotEnoughDataError: the corners cannot be seen through the cover.
    """
    path, values = pinhole_path(setup.intrinsics)
    poses = pinhole_poses(path, values, observations)
    residual = residuals(path, values, observations, poses)
    stages = [Stage("pinhole", residual.rms_px, residual.rmse_cm)]
    has_poses = bool(torch.isfinite(poses).all())  # the caller rejects views without a pose first
    is_bare = setup.cover.shape == "none"
    if not has_poses or (is_bare and (settings.method == "paper" or setup.intrinsics_are_final)):
        return Fitted(path, values, poses, tuple(stages), residual)
    if is_bare:
        priors = priors_of(setup.intrinsics, setup.cover, path)
        start = earlier.joint.start if earlier and earlier.joint else None
        model = CameraModel(path, values, priors)
        joint = model.fit(observations, earlier.poses if earlier else poses, start)
        residual = residuals(path, joint.values, observations, joint.poses)
        stages = [Stage("pinhole", residual.rms_px, residual.rmse_cm)]
        return _with_bend(model, joint, setup, observations, settings, labels, bend, tuple(stages))
    path, values = covered_path(setup.intrinsics, setup.cover)
    poses = refine_poses(path, values, observations, poses).blocks
    residual = residuals(path, values, observations, poses)
    _check_cover(residual)
    stages.append(Stage("cover", residual.rms_px, residual.rmse_cm))
    priors = priors_of(setup.intrinsics, setup.cover, path)
    start = earlier.joint.start if earlier and earlier.joint else None
    if earlier and start:
        poses = earlier.poses
    elif priors.sigmas and settings.method == "joint" and not setup.cover.glass:
        # A wrong number is corrected first, while there is no relief that could imitate it.
        rough = fit_joint(path, values, observations, poses, priors=priors, rounds=ROUGH_ROUNDS)
        start, poses = replace(rough.start, smoothness=GOOD_GLASS), rough.poses
    assert settings.grid, "the caller chooses the grid"
    around, axial = settings.grid
    relief = earlier.relief if earlier else None
    if not relief:
        low, high = patch(setup, path, start.values if start else values)
        relief = Relief(low, high, (axial, around))
    path = with_relief(path, relief, exact_hit=settings.exact_hit)
    flat = {AMPLITUDES: torch.from_numpy(expected_amplitudes(relief, setup.cover.glass))}
    values = {**values, **flat}
    if settings.method == "paper":
        values[AMPLITUDES] = _descend(path, values, observations, poses, settings.steps, progress)
        residual = residuals(path, values, observations, poses)
        stages.append(Stage("cover+rbf", residual.rms_px, residual.rmse_cm))
        return Fitted(path, values, poses, tuple(stages), residual, relief)
    advance = progress.task(f"Joint fit, {purpose}" if purpose else "Joint fit", LINEARISATIONS)
    if start:
        start = replace(start, values={**flat, **start.values})
    elif setup.cover.glass:
        start = Start(values, FIRST_SIGMA, GOOD_GLASS)
    joint = fit_joint(
        path,
        values,
        observations,
        poses,
        priors=priors,
        start=start,
        progress=lambda count, rms: advance(min(count, LINEARISATIONS), f"{rms:.3f} px"),
    )
    advance(LINEARISATIONS, "")
    residual = residuals(path, joint.values, observations, joint.poses)
    stages.append(Stage("cover+rbf", residual.rms_px, residual.rmse_cm))
    model = CameraModel(path, values, priors)
    return _with_bend(
        model, joint, setup, observations, settings, labels, bend, tuple(stages), relief
    )


def _with_bend(
    model: CameraModel,
    joint: JointFit,
    setup: Setup,
    observations: Observations,
    settings: Settings,
    labels: NDArray[np.int64] | None,
    bend: tuple[Effect, ...] | None,
    stages: tuple[Stage, ...],
    relief: Relief | None = None,
) -> Fitted:
    """Return the joint fit of a flat board, with the board's bend if the views show one."""
    if bend:
        model = model.with_effects(bend)
        joint = model.fit(observations, joint.poses, joint.start, ROUNDS)
    turned: tuple[str, ...] = ()
    if bend is None and settings.estimates_bend:
        is_turned = find_turned(model, observations, joint, setup.board)
        turned = tuple(compress(observations.names, is_turned))
        model, joint = estimate_bend(model, observations, joint, setup.board, labels)
    residual = residuals(model.path, joint.values, observations, joint.poses)
    if model.effects:
        stages = (*stages, Stage(EFFECTS_STAGE, residual.rms_px, residual.rmse_cm))
    return Fitted(
        path=model.path,
        values=joint.values,
        poses=joint.poses,
        stages=stages,
        residuals=residual,
        relief=relief,
        joint=joint,
        model=model,
        turned=turned,
    )


def patch(
    setup: Setup, path: Path, values: Values
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the low and high chart coordinates of the relief: those of a known glass, else of the
    cover's area that the camera sees, with a margin.
    """
    glass = setup.cover.glass
    return (
        (glass.low, glass.high)
        if glass
        else footprint(path, values, setup.camera.width, setup.camera.height)
    )


def _descend(
    path: Path,
    values: Values,
    observations: Observations,
    poses: Tensor,
    steps: int,
    progress: Progress,
) -> Tensor:
    advance = progress.task("Relief", steps)
    corners = len(observations.weight)
    return descend(
        path,
        values,
        observations,
        poses,
        steps=steps,
        progress=lambda step, loss: advance(step, f"{100 * (loss / corners) ** 0.5:.4f} cm"),
    )


def _check_cover(residual: Residuals) -> None:
    failed = (~torch.isfinite(residual.image + residual.board)).any(-1)
    fraction = float(failed.double().mean())
    if fraction > MAX_LOST_FRACTION:
        raise NotEnoughDataError(
            f"{100 * fraction:.0f} % of the corners are seen where this cover lets no ray from the"
            " camera to the board: check the cover's numbers and board.square_mm in session.yaml."
        )
