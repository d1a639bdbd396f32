"""The pose of the board that best separates effects which the existing views confound.

If one effect can do what another does, the information on both has a near-null direction. The best
view of a bank of poses is the one that leaves the smallest predicted sigma of the effect, with its
rivals free as well.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.corners.view import View
from calib.effects.effect import Effect
from calib.estimation.observations import Observations
from calib.inference.fitted_model import FittedModel
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.parameter_names import CAMERA
from calib.session.point_target import PointTarget

Array = NDArray[np.float64]

BANK_POINTS = 100
"""The points of a target without a grid in a view of the bank, about."""
DEPTHS = (0.5, 1.0, 2.0)
"""Depths of the bank, relative to the median depth of the views."""
PLACES = (0.25, 0.5, 0.75)
"""Places of the board's centre, as fractions of the picture's width and height."""
TILT = float(np.radians(40.0))
TILTS = ((0.0, 0.0), (-TILT, 0.0), (TILT, 0.0), (0.0, -TILT), (0.0, TILT))
"""Rotations about x and y in rad."""
TURNS = (0.0, np.pi / 2)
"""Rotations about the board's normal in rad."""


@dataclass(frozen=True, slots=True, eq=False)
class SeparatingView:
    """The view of the bank that separates effects best."""

    pose: Array
    """(6,) T_camera_board: rotation vector (rad) and translation (m)."""
    corners: Array
    """(count, 2) px, the corners in the view."""
    turned: bool
    """True if the board is turned by 90 degrees about its normal."""
    depth_range: tuple[float, float]
    """The smallest and the largest depth of the bank in m."""
    sigma_factor: float
    """The factor by which this view alone reduces the effect's sigma."""


def separating_view(
    fitted: FittedModel, board: Board, camera: Camera, effect: Effect, rivals: Sequence[Effect]
) -> SeparatingView | None:
    """Return the best view of the bank; None if no pose shows the whole board.

    Args:
        fitted: the fit with `effect`.
        rivals: the effects that it is confounded with, which are not in the fit.
    """
    poses = torch.from_numpy(np.array(list(_pose_bank(fitted, camera))))
    if not board.has_grid:
        board = PointTarget.of(board.points()[:: max(1, board.count // BANK_POINTS)])
    corners = torch.from_numpy(board.points())
    path = fitted.model.path
    values = fitted.joint.values
    count = board.count
    index = torch.arange(len(poses)).repeat_interleave(count)
    static = fitted.model.pad_poses(poses)
    points = path.place(corners.repeat(len(poses), 1), values, static[index], MIDDLE)
    pixels = project(path, values, points, MIDDLE)
    last = torch.tensor([camera.width - 1, camera.height - 1])
    in_picture = ((pixels >= 0) & (pixels <= last)).all(-1)
    visible = in_picture.reshape(-1, count).all(-1)
    if not bool(visible.any()):
        return None
    pictured = pixels.reshape(-1, count, 2)[visible].numpy()
    views = [View(str(n), pixels, np.ones(count)) for n, pixels in enumerate(pictured)]
    observations = Observations.of(views, board).add_times(None, camera.height)
    joint = replace(fitted.joint, poses=static[visible])
    bank = replace(fitted, observations=observations, joint=joint)
    information = fitted.information(rivals).sum(0) + fitted.prior_precision(rivals)
    sigma = _sigma(information, fitted, effect)
    new_sigmas = _sigma(information + bank.information(rivals), fitted, effect)
    best = int(new_sigmas.argmin())
    return SeparatingView(
        pose=poses[visible][best].numpy(),
        corners=pictured[best],
        turned=bool(np.flatnonzero(visible.numpy())[best] % len(TURNS)),
        depth_range=(float(poses[:, 5].min()), float(poses[:, 5].max())),
        sigma_factor=float(sigma / new_sigmas[best]),
    )


def _pose_bank(fitted: FittedModel, camera: Camera) -> Iterator[Array]:
    """Yield (6,) poses that place the board's centre over the picture of a pinhole."""
    observations = fitted.observations
    values = fitted.joint.values
    path = fitted.model.path
    view_poses = fitted.joint.poses[observations.view]
    points = path.place(observations.corners, values, view_poses, observations.exposure)
    median_distance = float(path.distance(points).median())
    focal = float(values[CAMERA.fx])
    cx = float(values[CAMERA.cx])
    cy = float(values[CAMERA.cy])
    for ratio, x, y, tilt, turn in product(DEPTHS, PLACES, PLACES, TILTS, TURNS):
        depth = ratio * median_distance
        ray = np.array([x * camera.width - cx, y * camera.height - cy, focal]) / focal
        rotation = Rotation.from_rotvec([*tilt, 0.0]) * Rotation.from_rotvec([0.0, 0.0, turn])
        yield np.concatenate([rotation.as_rotvec(), ray * depth])


def _sigma(information: Array, fitted: FittedModel, effect: Effect) -> Array:
    """Return (...), the root mean square sigma of the effect's parameters over their scales."""
    entries = fitted.parameters().entries(
        unknown.param.name for unknown in effect.effect_parameters
    )
    variance = np.linalg.inv(information)[..., entries, entries]
    return np.asarray(np.sqrt(variance.mean(-1)))
