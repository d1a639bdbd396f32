"""Evaluate a calibration on held-out views: only the pose of each view is refitted."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from os import PathLike
from pathlib import Path as FilePath

import numpy as np
import torch
from torch import Tensor

from calib.calibration import Calibration, CalibrationSource
from calib.corners.copies import count_fitted
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import RejectedPicture, View
from calib.effects.board_shape import BoardShape
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.observations import Observations
from calib.estimation.poses import refit_poses
from calib.estimation.residuals import Residuals, residuals
from calib.estimation.robust import outlier_mask
from calib.fitting.inputs import read_views, session_of_pictures
from calib.fitting.with_initial_pose import with_initial_pose
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.view_blocks import with_blocks
from calib.progress import Progress, Silent, check_progress
from calib.session.board import Board
from calib.session.session import Session, SessionSource
from calib.threads import single_thread

MIN_VIEWS = 4
"""The fewest views of which one can be told from the others."""
FIRST_BAND_END = 0.125
"""m: the end of the first depth band. Each further band ends at twice the distance."""


@dataclass(frozen=True, slots=True)
class Band:
    """The error of the corners in a range of distances."""

    from_m: float
    to_m: float
    rms_px: float
    rmse_cm: float
    corners: int


@dataclass(frozen=True, slots=True)
class BadView:
    """A view whose error is far from that of the others."""

    file: str
    rms_px: float


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The error on held-out views."""

    rms_px: float
    """Root mean square two-dimensional reprojection error."""
    rmse_cm: float
    frames_used: int
    by_depth: tuple[Band, ...]
    """The error by the distance of the corners (`Path.distance`), near to far. Every corner is in
    one band; bands without corners are left out.
    """
    near_m: float
    """The nearest corner's distance."""
    far_m: float
    rejected: tuple[RejectedPicture, ...]
    """Pictures in which no board with enough corners was found. No view is dropped for its error.
    """
    bad_views: tuple[BadView, ...] = ()
    """The views with outlying errors, the worst first; they count in `rms_px` all the same."""
    other_views_rms_px: float | None = None
    """The error of the views without the bad ones; None if there are none."""
    fitted_views: int = 0
    """The number of views that the calibration was fitted to, which are no test of it."""
    board: Board | None = None
    """The board that the session describes."""


def evaluate(
    calibration: CalibrationSource,
    session: SessionSource,
    progress: Progress = Silent(),
    *,
    halves: bool = False,
) -> Evaluation:
    """Refit the poses of a session's views with the camera and cover of a calibration, and measure
    the residual.

    A session with another board is measured without what the calibration knows of its own board's
    shape and print.

    Args:
        calibration: the calibration, or the path of its file or folder.
        session: the session, or the path of its folder, or of a folder of pictures of the board and
            the camera mode that the calibration is of.
        halves: measure each half of a view's corners with the pose that the other half gives. This
            is always done if boards move during the readout.

    Raises:
        InputError: the session is of another camera mode.
        NotEnoughDataError: no view can be used.
    """
    check_progress(progress)
    calibration = Calibration.of(calibration)
    session, size, left_out = held_out_session(session, calibration)
    camera = calibration.camera
    if size != (camera.width, camera.height):
        raise InputError(
            f"{session.path} is of {size[0]}x{size[1]} px and the calibration for"
            f" {camera.width}x{camera.height}: evaluate with a session of the calibrated camera"
            " mode."
        )
    views, rejected = read_views(session, progress)
    views, unusable = split_usable_views(views, session.board)
    if session.board != calibration.board:
        calibration = _without_board_effects(calibration)
    path, values = calibration.model()
    views, poses, poseless = with_initial_pose(path, values, views, session.board)
    if not views:
        raise NotEnoughDataError(
            f"{session.path} has no view to evaluate with: take pictures that show the whole board."
        )
    observations = Observations.of(views, session.board).add_times(None, camera.height)
    with single_thread():
        if halves or path.has_private_blocks:
            # sigma only weighs the prior of private blocks
            joint = calibration.outcome.joint
            noise = joint.sigma_px if joint and path.has_private_blocks else 1.0
            poses, residual = _cross_halves(path, values, observations, poses, noise)
        else:
            poses, residual = refit_poses(path, values, observations, poses)
    points = path.place(
        observations.corners, values, poses[observations.view], observations.exposure
    )
    distance = path.distance(points)
    bad_views, other_views = _split_off_bad_views(views, residual, observations)
    return Evaluation(
        rms_px=residual.rms_px,
        rmse_cm=residual.rmse_cm,
        frames_used=len(views),
        by_depth=_bands(residual, distance),
        near_m=float(distance.min()),
        far_m=float(distance.max()),
        rejected=(*left_out, *rejected, *unusable, *poseless),
        bad_views=bad_views,
        other_views_rms_px=other_views.rms_px if bad_views else None,
        fitted_views=count_fitted(views, calibration.views),
        board=session.board,
    )


def _split_off_bad_views(
    views: Sequence[View], residual: Residuals, observations: Observations
) -> tuple[tuple[BadView, ...], Residuals]:
    """Return the views that are outliers among the views, the worst first, and the residuals of the
    others. Few views have no outliers.
    """
    errors = residual.view_errors(observations)
    outlying = outlier_mask(errors) if len(views) >= MIN_VIEWS else np.zeros(len(views), bool)
    bad_views = [
        BadView(view.name, float(error))
        for view, error, is_bad in zip(views, errors, outlying, strict=True)
        if is_bad and np.isfinite(error)
    ]
    good_rows = torch.from_numpy(~outlying)[observations.view]
    other_views = Residuals(residual.image[good_rows], residual.board[good_rows])
    return tuple(sorted(bad_views, key=lambda view: -view.rms_px)), other_views


def held_out_session(
    source: SessionSource, calibration: Calibration
) -> tuple[Session, tuple[int, int], tuple[RejectedPicture, ...]]:
    """Return the session of held-out views, the size of its pictures in px, and those that are left
    out. A folder of pictures without a session.yaml shows the calibration's board.
    """
    if isinstance(source, str | PathLike):
        folder = FilePath(source)
        if folder.is_dir() and not (folder / "session.yaml").exists():
            return session_of_pictures([folder], calibration)
    session = Session.of(source)
    return session, (session.camera.width, session.camera.height), ()


def _without_board_effects(calibration: Calibration) -> Calibration:
    """Return the calibration without the effects of its board, as for views of another board."""
    effects = tuple(e for e in calibration.effects if e.effect.about != BoardShape.about)
    return replace(calibration, effects=effects)


def _cross_halves(
    path: Path, values: Values, observations: Observations, poses: Tensor, sigma: float
) -> tuple[Tensor, Residuals]:
    """Measure each half of a view's corners with the view's parameters that the other half gives: a
    view may have so many parameters that they would hide its error. sigma: px, of a corner.
    """
    poses = with_blocks(poses, path.view_blocks)
    odd = alternate_rows(observations)
    image, board = torch.empty_like(observations.pixels), torch.empty_like(observations.pixels)
    for scored in (odd, ~odd):
        refitted, _ = refit_poses(
            path, values, observations.select_rows(~scored), poses, sigma=sigma
        )
        residual = residuals(path, values, observations, refitted)
        image[scored] = residual.image[scored]
        board[scored] = residual.board[scored]
    return refitted, Residuals(image, board)


def alternate_rows(observations: Observations) -> Tensor:
    """Return (M,) true for every second corner of each view."""
    rows = torch.arange(len(observations.pixels))
    return (rows - observations.starts[observations.view]) % 2 == 1


def _bands(residual: Residuals, distance: Tensor) -> tuple[Band, ...]:
    edges = [0.0, FIRST_BAND_END]
    while edges[-1] <= float(distance.max()):
        edges.append(2 * edges[-1])
    # Unless the lens is wide, a corner behind it has a negative depth; the first band takes it.
    distance = distance.clamp_min(0.0)
    bands = []
    for low, high in pairwise(edges):
        members = (distance >= low) & (distance < high)
        if bool(members.any()):
            band = Residuals(residual.image[members], residual.board[members])
            bands.append(Band(low, high, band.rms_px, band.rmse_cm, int(members.sum())))
    return tuple(bands)
