"""From a session to a calibration."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.calibration import Calibration, Stage
from calib.camera import Intrinsics
from calib.detections import detect
from calib.errors import NotEnoughDataError
from calib.intrinsics import FEWEST_CORNERS, calibrate_bare
from calib.noise import short_scale_noise
from calib.observations import Observations
from calib.optics.build import covered_path, footprint, pinhole_path, with_relief
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.paper import descend
from calib.poses import pinhole_poses, refine_poses
from calib.progress import Progress
from calib.residuals import Residuals, residuals
from calib.robust import outlying
from calib.session import Session, check_images
from calib.threads import single_thread
from calib.views import Rejected, View
from calib.vnlog import read_corners

FEWEST_VIEWS = 3
GAUGE = "camera frame at the pinhole; cover and intrinsics held at the session's numbers; poses as a smooth cover gives them"
GAUGE_BARE = "camera frame at the pinhole"


@dataclass(frozen=True, slots=True)
class Settings:
    """What a fit is asked to do."""

    grid: tuple[int, int] = (8, 8)
    """Centres of the relief around and along the cover (horizontally and vertically for an upright cone)."""
    steps: int = 1000
    """Gradient steps."""
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


def fit(session: Session, settings: Settings, progress: Progress) -> Calibration:
    """Calibrate a session by the paper's procedure (its section 4.2).

    Raises:
        InputError: a picture or corners file is damaged.
        NotEnoughDataError: too few views show the board.
    """
    views, rejected, intrinsics, lens_tried = _gather(session, progress)
    while True:
        _check_enough(views, rejected)
        observations = Observations.of(views, session.board)
        with single_thread():
            fitted = _fit_once(session, intrinsics, observations, settings, progress)
        views, bad = _without_outliers(views, observations, fitted)
        if not bad:
            break
        rejected = (*rejected, *bad)
    return Calibration(
        board=session.board,
        camera=replace(session.camera, intrinsics=intrinsics),
        cover=session.cover,
        relief=fitted.relief,
        amplitudes=fitted.values["relief.amplitudes"].numpy() if fitted.relief else np.zeros((0, 0)),
        exact_hit=settings.exact_hit,
        views=views,
        poses=fitted.poses.numpy(),
        rejected=rejected,
        stages=fitted.stages,
        noise_px=short_scale_noise(_on_board(fitted.residuals.image, views), session.board),
        settings={
            "method": "paper",
            "grid": list(settings.grid),
            "steps": settings.steps,
            "exact_hit": settings.exact_hit,
            "lens_held_out_px": lens_tried,
        },
        gauge=GAUGE if fitted.relief else GAUGE_BARE,
    )


def read_views(session: Session, progress: Progress) -> tuple[tuple[View, ...], tuple[Rejected, ...]]:
    """The session's corners: from its corners file, or detected in its pictures."""
    if session.corners:
        return read_corners(session.corners, session.board), ()
    check_images(session)
    advance = progress.task(f"Corners in {session.path.name}", len(session.frames))
    found = detect(session.frames, session.board, lambda done, hits: advance(done, f"{hits} boards found"))
    return found.views, found.rejected


def _gather(session: Session, progress: Progress) -> tuple[tuple[View, ...], tuple[Rejected, ...], Intrinsics, dict[int, float]]:
    """The usable views, the others, the intrinsics, and the held-out errors by which their lens was chosen.

    Intrinsics come from the session where it states them, else from bare/, else, without a cover, from the views themselves.
    """
    views, rejected = read_views(session, progress)
    bare: tuple[Rejected, ...] = ()
    tried: dict[int, float] = {}
    if session.camera.intrinsics:
        intrinsics = session.camera.intrinsics
    elif session.bare:
        shown, dropped = read_views(session.bare, progress)
        fitted = calibrate_bare(shown, session.bare.board, session.camera, progress)
        bare = tuple(Rejected(f"{session.bare.path.name}/{r.name}", r.reason) for r in (*dropped, *fitted.rejected))
        intrinsics, tried = fitted.intrinsics, fitted.held_out_px
    else:
        fitted = calibrate_bare(views, session.board, session.camera, progress)
        views, bare, intrinsics, tried = fitted.views, fitted.rejected, fitted.intrinsics, fitted.held_out_px
    few = [view for view in views if view.count < FEWEST_CORNERS]
    too_few = (Rejected(v.name, f"only {v.count} corners are seen, and a pose needs {FEWEST_CORNERS}") for v in few)
    return tuple(view for view in views if view.count >= FEWEST_CORNERS), (*rejected, *bare, *too_few), intrinsics, tried


def _fit_once(session: Session, intrinsics: Intrinsics, observations: Observations, settings: Settings, progress: Progress) -> _Fitted:
    path, values = pinhole_path(intrinsics)
    poses = pinhole_poses(observations, values)
    missed = residuals(path, values, observations, poses)
    stages = [Stage("pinhole", missed.rms_px, missed.rmse_cm)]
    if session.cover.shape == "none":
        return _Fitted(path, values, poses, tuple(stages), missed)
    path, values = covered_path(intrinsics, session.cover)
    poses = refine_poses(path, values, observations, poses).blocks
    missed = residuals(path, values, observations, poses)
    stages.append(Stage("cover", missed.rms_px, missed.rmse_cm))
    low, high = footprint(path, values, session.camera.width, session.camera.height)
    around, along = settings.grid
    relief = Relief(low, high, (along, around))
    path = with_relief(path, relief, exact_hit=settings.exact_hit)
    values["relief.amplitudes"] = torch.zeros(along, around, dtype=torch.float64)
    advance = progress.task("Relief", settings.steps)
    corners = len(observations.weight)
    values["relief.amplitudes"] = descend(
        path,
        values,
        observations,
        poses,
        steps=settings.steps,
        progress=lambda step, loss: advance(step, f"{100 * (loss / corners) ** 0.5:.4f} cm"),
    )
    missed = residuals(path, values, observations, poses)
    stages.append(Stage("cover+rbf", missed.rms_px, missed.rmse_cm))
    return _Fitted(path, values, poses, tuple(stages), missed, relief)


def _without_outliers(views: Sequence[View], observations: Observations, fitted: _Fitted) -> tuple[tuple[View, ...], tuple[Rejected, ...]]:
    squared = (fitted.residuals.image**2).sum(-1)
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


def _check_enough(views: Sequence[View], rejected: Sequence[Rejected]) -> None:
    if len(views) < FEWEST_VIEWS:
        why = f" (the first that was dropped, {rejected[0].name}: {rejected[0].reason})" if rejected else ""
        raise NotEnoughDataError(
            f"Only {len(views)} views are usable and a fit needs {FEWEST_VIEWS}: take more pictures of the board{why}."
        )


def _on_board(errors: Tensor, views: Sequence[View]) -> NDArray[np.float64]:
    """(M, 2) px of the seen corners to (V, corners of the board, 2), NaN where not seen."""
    full = np.full((len(views), len(views[0].weight), 2), np.nan)
    full[np.array([view.seen for view in views])] = errors.numpy()
    return full
