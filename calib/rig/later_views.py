"""Later pictures of a calibrated rig: their corners, and the placements of the board in them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from calib.calibration import Calibration
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import View
from calib.errors import InputError, brief
from calib.estimation.levenberg_marquardt import minimise
from calib.estimation.objective import LandingProblem, view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.poses import refit_poses
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.estimation.residuals import reach_board
from calib.fitting.inputs import read_views
from calib.fitting.with_initial_pose import with_initial_pose
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.view_blocks import with_blocks
from calib.progress import Progress
from calib.rig.mounting_start import nearest_turns, turn_view
from calib.rig.placements import Placements
from calib.rig.poses import compose, invert_poses
from calib.rig.problem import CameraProblem, RigProblem
from calib.rig.rig import Rig
from calib.rig.rig_file import RigDescription
from calib.session.board import Board
from calib.session.point_target import in_space
from calib.threads import single_thread


@dataclass(frozen=True, slots=True, eq=False)
class LaterViews:
    """Views of one camera that its calibration was not fitted to."""

    calibration: Calibration
    board: Board
    """The board of these views. A target of points has the points of its own views."""
    views: tuple[View, ...]
    poses: Tensor
    """(V, 6) T_camera_board of each view by itself, without the bend of its board."""


def read_later_views(
    rig: Rig, description: RigDescription, name: str, progress: Progress
) -> tuple[LaterViews, list[tuple[str, str]]]:
    """Return a camera's views with their poses, and the pictures that are left out."""
    session = description.sessions[name]
    if name not in rig.calibrations:
        raise InputError(
            f"{description.file}: cameras has {brief(repr(name))}, and the calibrated rig has"
            f" {', '.join(rig.names)}: name the cameras as these."
        )
    calibration = rig.calibrations[name]
    size = session.camera.width, session.camera.height
    camera = calibration.camera
    if size != (camera.width, camera.height):
        raise InputError(
            f"{session.path} is of {size[0]}x{size[1]} px and the calibration of {name} for"
            f" {camera.width}x{camera.height}: take pictures in the calibrated camera"
            " mode."
        )
    if not calibration.board.is_flat:
        session = replace(session, board=in_space(session.board))
    if session.board != calibration.board:
        raise InputError(
            f"{session.path} has a {session.board} board of {1e3 * session.board.square:g} mm and"
            f" the calibrated rig a {calibration.board} one of"
            f" {1e3 * calibration.board.square:g} mm: take pictures of the same board, or correct"
            " its description."
        )
    views, rejected = read_views(session, progress)
    views, unusable = split_usable_views(views, session.board)
    path, values = calibration.model()
    views, poses, poseless = with_initial_pose(path, values, views, session.board)
    if views:
        observations = Observations.of(views, session.board)
        start = with_blocks(poses, path.view_blocks)
        sigma = calibration.corner_sigma_px if path.has_private_blocks else 1.0
        with single_thread():
            placed, _ = refit_poses(path, values, observations, start, sigma=sigma)
        poses = placed[:, :6]
    dropped = [(r.name, r.reason) for r in (*rejected, *unusable, *poseless)]
    return LaterViews(calibration, session.board, views, poses), dropped


def mounting_of(rig: Rig, name: str) -> Tensor:
    """Return the (6,) T_camera_reference of a camera."""
    return torch.from_numpy(rig.mountings[rig.names.index(name)])


def renumber_views(
    rig: Rig, cameras: Mapping[str, LaterViews], placements: Placements
) -> dict[str, LaterViews]:
    """Return the views with their corners in the order of the first camera that saw the same
    placement.
    """
    placed = torch.full((placements.count, 6), torch.nan, dtype=torch.float64)
    renumbered = {}
    for name, camera in cameras.items():
        place = torch.from_numpy(placements.of_views[name])
        mounting = mounting_of(rig, name)
        board = camera.board
        expected = compose(mounting, placed[place])
        quarters, poses = nearest_turns(camera.poses, expected, board)
        views = tuple(
            turn_view(view, board, count)
            for view, count in zip(camera.views, quarters.tolist(), strict=True)
        )
        placed_poses = compose(invert_poses(mounting), poses)
        for row, index in enumerate(place.tolist()):
            if bool(placed[index, 0].isnan()):
                placed[index] = placed_poses[row]
        renumbered[name] = replace(camera, views=views, poses=poses)
    return renumbered


@dataclass(frozen=True, slots=True, eq=False)
class PlacedViews:
    """Views of one camera at one mounting, and which placements of the board they show."""

    path: Path
    values: Values
    observations: Observations
    mounting: Tensor
    """(6,) T_camera_reference."""
    placement: Tensor
    """(V,) int64"""

    def poses(self, placements: Tensor) -> Tensor:
        """Return the (V, B) T_camera_board of the views for (P, B) placements."""
        return compose(self.mounting, placements[self.placement])


def fit_placements(views: Sequence[PlacedViews], start: Tensor, sigma: float = 1.0) -> Tensor:
    """Return the (P, B) placements T_reference_board of least reprojection error, one for all
    cameras. If the board bends differently in every placement, each has a bend.

    Args:
        start: (P, 6) or (P, B) placements to start from.
        sigma: px; single bad corners beyond three times this pull less. It also weights the corners
            against the prior of bends.
    """
    problems = []
    start = with_blocks(start, views[0].path.view_blocks)
    empty = torch.zeros(0, dtype=torch.int64)
    for placed in views:
        path, values, observations = placed.path, placed.values, placed.observations
        poses = placed.poses(start)
        observations = observations.select_rows(reach_board(path, values, observations, poses))
        weights = pixel_weights(path, values, observations, poses, sigma)
        parameters = Parameters.none(values)
        blocks = tuple(make_residual_blocks(path, parameters, observations, weights))
        landing = LandingProblem(
            parameters, blocks, weights.new_zeros(0, 0), poses.new_zeros(poses.shape[1])
        )
        problems.append(CameraProblem(landing, empty, placed.mounting, empty, placed.placement))
    precision = view_precision(views[0].path, start)
    problem = RigProblem(tuple(problems), start.new_zeros(0, 0), precision)
    return minimise(problem, start.new_zeros(0), start).blocks


def first_placements(
    mountings: Sequence[Tensor], poses: Sequence[Tensor], placement: Sequence[Tensor], count: int
) -> Tensor:
    """Return the (P, 6) placements by the first camera that saw each.

    Args:
        mountings: (6,) T_camera_reference of each camera.
        poses: (V, 6) T_camera_board of its views.
        placement: (V,) the placements of its views.
        count: P.
    """
    placed = torch.full((count, 6), torch.nan, dtype=torch.float64)
    for mounting, views, places in zip(mountings, poses, placement, strict=True):
        in_reference = compose(invert_poses(mounting), views)
        is_new = placed[places, 0].isnan()
        placed[places[is_new]] = in_reference[is_new]
    return placed
