"""From a session to a calibration."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.calibration import Calibration, Stage
from calib.camera import Intrinsics
from calib.errors import NotEnoughDataError
from calib.gather import gather
from calib.joint import JointFit, fit_joint
from calib.noise import short_scale_noise
from calib.observations import Observations
from calib.optics.build import covered_path, footprint, pinhole_path, with_relief
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.paper import descend
from calib.poses import pinhole_poses, refine_poses
from calib.priors import freed, with_estimates
from calib.progress import Progress
from calib.residuals import Residuals, residuals
from calib.robust import outlying
from calib.session import Session
from calib.threads import single_thread
from calib.views import Rejected, View

FEWEST_VIEWS = 3
MOST_LOST = 0.2
"""Of the corners: more cannot be seen through the cover as it is described."""
LINEARISATIONS = 40
"""About as many as a joint fit takes; the bar's length."""
GAUGES = {
    "bare": "camera frame at the pinhole",
    "paper": "camera frame at the pinhole; cover and intrinsics held as stated, or as bare/ gives them; poses as a smooth cover gives them",
    "joint": "camera frame at the pinhole; cover and intrinsics held as stated, or as bare/ gives them, or near that by their priors; "
    "relief near zero by its prior",
}


@dataclass(frozen=True, slots=True)
class Settings:
    """What a fit is asked to do."""

    method: Literal["joint", "paper"] = "joint"
    grid: tuple[int, int] = (8, 8)
    """Centres of the relief around and along the cover (horizontally and vertically for an upright cone)."""
    steps: int = 1000
    """Gradient steps of the paper's procedure."""
    exact_hit: bool = True
    """False neglects that the relief moves the hit point, as the paper does."""


@dataclass(frozen=True, slots=True)
class _Fitted:
    path: Path
    values: Values
    poses: Tensor
    stages: tuple[Stage, ...]
    residuals: Residuals
    relief: Relief | None = None
    joint: JointFit | None = None


def fit(session: Session, settings: Settings, progress: Progress) -> Calibration:
    """Calibrate a session.

    Raises:
        InputError: a picture or corners file is damaged.
        NotEnoughDataError: too few views show the board.
    """
    start = gather(session, progress)
    views, rejected = start.views, start.rejected
    while True:
        _check_enough(views, rejected)
        observations = Observations.of(views, session.board)
        with single_thread():
            fitted = _fit_once(session, start.intrinsics, observations, settings, progress)
        views, bad = _without_outliers(views, observations, fitted.residuals)
        if not bad:
            break
        rejected = (*rejected, *bad)
    intrinsics, cover = with_estimates(start.intrinsics, session.cover, fitted.joint)
    joint = fitted.joint
    return Calibration(
        board=session.board,
        camera=replace(session.camera, intrinsics=intrinsics),
        cover=cover,
        relief=fitted.relief,
        amplitudes=fitted.values["relief.amplitudes"].numpy() if fitted.relief else np.zeros((0, 0)),
        exact_hit=settings.exact_hit,
        views=views,
        poses=fitted.poses.numpy(),
        covariance=joint.covariance.numpy() if joint else np.zeros((0, 0)),
        rejected=rejected,
        stages=fitted.stages,
        noise_px=short_scale_noise(_on_board(fitted.residuals.image, views), session.board),
        settings={
            "method": settings.method,
            "grid": list(settings.grid),
            "steps": settings.steps,
            "exact_hit": settings.exact_hit,
            "lens_held_out_px": {str(count): error for count, error in start.lens_held_out_px.items()},
        }
        | (joint.said() if joint else {}),
        gauge=GAUGES[settings.method if fitted.relief else "bare"],
    )


def _fit_once(session: Session, intrinsics: Intrinsics, observations: Observations, settings: Settings, progress: Progress) -> _Fitted:
    path, values = pinhole_path(intrinsics)
    poses = pinhole_poses(observations, values)
    missed = residuals(path, values, observations, poses)
    stages = [Stage("pinhole", missed.rms_px, missed.rmse_cm)]
    if session.cover.shape == "none" or not bool(torch.isfinite(poses).all()):  # a view without a pose is rejected first
        return _Fitted(path, values, poses, tuple(stages), missed)
    path, values = covered_path(intrinsics, session.cover)
    poses = refine_poses(path, values, observations, poses).blocks
    missed = residuals(path, values, observations, poses)
    _check_cover(missed)
    stages.append(Stage("cover", missed.rms_px, missed.rmse_cm))
    low, high = footprint(path, values, session.camera.width, session.camera.height)
    around, along = settings.grid
    relief = Relief(low, high, (along, around))
    path = with_relief(path, relief, exact_hit=settings.exact_hit)
    values["relief.amplitudes"] = torch.zeros(along, around, dtype=torch.float64)
    joint = None
    if settings.method == "paper":
        values["relief.amplitudes"] = _descend(path, values, observations, poses, settings.steps, progress)
    else:
        advance = progress.task("Joint fit", LINEARISATIONS)
        joint = fit_joint(
            path,
            values,
            observations,
            poses,
            free=freed(session, path),
            progress=lambda spent, rms: advance(min(spent, LINEARISATIONS), f"{rms:.3f} px"),
        )
        advance(LINEARISATIONS, "")
        values, poses = joint.values, joint.poses
    missed = residuals(path, values, observations, poses)
    stages.append(Stage("cover+rbf", missed.rms_px, missed.rmse_cm))
    return _Fitted(path, values, poses, tuple(stages), missed, relief, joint)


def _descend(path: Path, values: Values, observations: Observations, poses: Tensor, steps: int, progress: Progress) -> Tensor:
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


def _without_outliers(
    views: Sequence[View], observations: Observations, missed: Residuals
) -> tuple[tuple[View, ...], tuple[Rejected, ...]]:
    squared = (missed.image**2).sum(-1)
    errors = np.array([float(own.nanmean().sqrt()) for own in observations.per_view(squared)])
    bad = outlying(errors)
    reasons = (
        f"its {error:.2f} px do not fit the {np.nanmedian(errors):.2f} px of the other views"
        if np.isfinite(error)
        else "no board pose explains its corners"
        for error in errors
    )
    rejected = tuple(Rejected(view.name, reason) for view, reason, out in zip(views, reasons, bad, strict=True) if out)
    return tuple(view for view, out in zip(views, bad, strict=True) if not out), rejected


def _check_cover(missed: Residuals) -> None:
    lost = float((~torch.isfinite(missed.image + missed.board)).any(-1).double().mean())
    if lost > MOST_LOST:
        raise NotEnoughDataError(
            f"{100 * lost:.0f} % of the corners are seen where this cover lets no ray from the camera to the board: "
            "check the cover's numbers and board.square_mm in session.yaml."
        )


def _check_enough(views: Sequence[View], rejected: Sequence[Rejected]) -> None:
    if len(views) < FEWEST_VIEWS:
        why = f" (the first that was dropped, {rejected[0].name}: {rejected[0].reason})" if rejected else ""
        raise NotEnoughDataError(
            f"A fit needs {FEWEST_VIEWS} usable views and there are {len(views)}: take more pictures of the board{why}."
        )


def _on_board(errors: Tensor, views: Sequence[View]) -> NDArray[np.float64]:
    """(M, 2) px of the seen corners to (V, corners of the board, 2), NaN where not seen."""
    full = np.full((len(views), len(views[0].weight), 2), np.nan)
    full[np.array([view.seen for view in views])] = errors.numpy()
    return full
