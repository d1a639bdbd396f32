"""How good a calibration is on views that it has not seen: only each view's pose is refitted."""

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from calib.calibration import Calibration
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import RejectedPicture
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.observations import Observations
from calib.estimation.poses import refit_poses
from calib.estimation.residuals import Residuals, residuals
from calib.fitting.inputs import read_views
from calib.fitting.posable import posable
from calib.optics.board_target import with_blocks
from calib.optics.params import Values
from calib.optics.path import Path
from calib.progress import Progress, Silent
from calib.session.session import Session
from calib.threads import single_thread

NARROWEST = 0.125
"""m: where the depth bands begin to double; what is nearer is one band."""


@dataclass(frozen=True, slots=True)
class Band:
    """The error of the corners at some distances."""

    from_m: float
    to_m: float
    rms_px: float
    rmse_cm: float
    corners: int


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Held-out quality."""

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


def evaluate(
    calibration: Calibration,
    session: Session,
    progress: Progress = Silent(),
    *,
    halves: bool = False,
) -> Evaluation:
    """Refit the poses of a session's views, with the camera and cover of a calibration, and measure
    what is left.

    Args:
        halves: measure each half of a view's corners with the pose that the other half gives, as it
            is always done where boards move during the readout.

    Raises:
        InputError: the session is of another camera mode.
        NotEnoughDataError: no view can be used.
    """
    ours, theirs = calibration.camera, session.camera
    if (ours.width, ours.height) != (theirs.width, theirs.height):
        raise InputError(
            f"{session.path} is of {theirs.width}x{theirs.height} px and the calibration for"
            f" {ours.width}x{ours.height}: evaluate with a session of the calibrated camera mode."
        )
    views, rejected = read_views(session, progress)
    views, few = split_usable_views(views, session.board)
    path, values = calibration.model()
    views, poses, lost = posable(views, session.board, values)
    if not views:
        raise NotEnoughDataError(
            f"{session.path} has no view to evaluate with: take pictures that show the whole board."
        )
    observations = Observations.of(views, session.board).add_times(None, ours.height)
    with single_thread():
        if halves or path.has_private_blocks:
            noise = (
                float(calibration.settings.get("sigma_px", 1.0)) if path.has_private_blocks else 1.0
            )  # else there is no prior to weigh
            poses, missed = _by_halves(path, values, observations, poses, noise)
        else:
            poses, missed = refit_poses(path, values, observations, poses)
    points = path.place(
        observations.corners, observations.with_times(values), poses[observations.view]
    )
    distance = path.distance(points)
    near, far = float(distance.min()), float(distance.max())
    return Evaluation(
        missed.rms_px,
        missed.rmse_cm,
        len(views),
        _bands(missed, distance),
        near,
        far,
        (*rejected, *few, *lost),
    )


def _by_halves(
    path: Path, values: Values, observations: Observations, poses: Tensor, sigma: float
) -> tuple[Tensor, Residuals]:
    """Each half of a view's corners measured with the parameters that the other half gives: where a
    view has so many of its own that they would hide its error. sigma: px, of a corner.
    """
    poses = with_blocks(poses, path.view_blocks)
    odd = (torch.arange(len(observations.pixels)) - observations.starts[observations.view]) % 2 == 1
    image, board = torch.empty_like(observations.pixels), torch.empty_like(observations.pixels)
    for scored in (odd, ~odd):
        own, _ = refit_poses(path, values, observations.select_rows(~scored), poses, sigma=sigma)
        missed = residuals(path, values, observations, own)
        image[scored], board[scored] = missed.image[scored], missed.board[scored]
    return own, Residuals(image, board)


def _bands(missed: Residuals, distance: Tensor) -> tuple[Band, ...]:
    edges = [0.0, NARROWEST]
    while edges[-1] <= float(distance.max()):
        edges.append(2 * edges[-1])
    # Unless the lens is wide, a corner behind it has a negative depth; the first band takes it.
    distance = distance.clamp_min(0.0)
    bands = []
    for low, high in pairwise(edges):
        inside = (distance >= low) & (distance < high)
        if bool(inside.any()):
            part = Residuals(missed.image[inside], missed.board[inside])
            bands.append(Band(low, high, part.rms_px, part.rmse_cm, int(inside.sum())))
    return tuple(bands)
