"""Evaluate a rig on held-out placements of the board: one pose for all cameras, and lengths on the
board against the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.calibration import Calibration
from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError, brief, wrong_type
from calib.estimation.levenberg_marquardt import minimise
from calib.estimation.objective import LandingProblem, view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.poses import refit_poses
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.estimation.residuals import Residuals, residuals
from calib.fitting.evaluate import FIRST_BAND_END
from calib.fitting.inputs import read_views
from calib.fitting.with_initial_pose import with_initial_pose
from calib.optics.exposure import MIDDLE
from calib.progress import Progress, Silent, check_progress
from calib.rig.mounting_start import nearest_turns, turn_view
from calib.rig.placements import Indices, Placements
from calib.rig.poses import compose, invert_poses
from calib.rig.problem import CameraProblem, RigProblem
from calib.rig.rig import Rig, RigCalibrationSource
from calib.rig.rig_content import RejectedView
from calib.rig.rig_file import RigDescription, RigSource, read_rig
from calib.session.board import Board
from calib.threads import single_thread

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LengthBand:
    """The errors of lengths between corners of one board, in a range of depths."""

    from_m: float
    to_m: float
    rms_mm: float
    sigma_mm: float
    """The root mean square of the predicted standard deviations, which include the noise of the
    corners.
    """
    normalised: float
    """The root mean square of error over sigma."""
    lengths: int


@dataclass(frozen=True, slots=True)
class RigEvaluation:
    """The error of a rig on held-out placements."""

    rms_px: float
    """Root mean square two-dimensional reprojection error, with one pose for all cameras."""
    cameras: Mapping[str, float]
    """px: the same for each camera."""
    placements: int
    shared_placements: int
    """Placements that two cameras or more saw."""
    lengths: tuple[LengthBand, ...]
    """Near to far; bands without lengths are left out."""
    rejected: tuple[RejectedView, ...]


@dataclass(frozen=True, slots=True, eq=False)
class _HeldOut:
    """The held-out views of one camera."""

    calibration: Calibration
    views: tuple[View, ...]
    poses: Tensor
    """(V, 6) T_camera_board of each view by itself."""


def evaluate_rig(
    rig: RigCalibrationSource, source: RigSource, progress: Progress = Silent()
) -> RigEvaluation:
    """Refit the placements of a rig's held-out pictures, with the cameras and mountings of a
    calibrated rig, and measure the residual and the lengths on the board.

    Args:
        rig: the calibrated rig, or the path of its folder.
        source: the held-out pictures: a rig.yaml whose cameras are some of the rig's.
        progress: the progress bars.

    Raises:
        WrongTypeError: an argument is of another type.
        InputError: the pictures are of other cameras.
        NotEnoughDataError: no picture can be used.
    """
    check_progress(progress)
    if not isinstance(rig, Rig | str) and not hasattr(rig, "__fspath__"):
        raise wrong_type("rig", rig, "a calib.Rig, or the path of its folder")
    calibrated = rig if isinstance(rig, Rig) else Rig.load(rig)
    description = read_rig(source)
    rejected: list[RejectedView] = []
    cameras: dict[str, _HeldOut] = {}
    for name in description.sessions:
        held_out, dropped = _read(calibrated, description, name, progress)
        rejected += [RejectedView(name, picture, reason) for picture, reason in dropped]
        cameras[name] = held_out
    if not any(camera.views for camera in cameras.values()):
        raise NotEnoughDataError(
            f"{description.file} has no picture to evaluate with: take pictures that show the whole"
            " board."
        )
    placements = Placements.of(description, {name: c.views for name, c in cameras.items()})
    with single_thread():
        cameras = _renumbered(calibrated, cameras, placements)
        poses = _fit_placements(calibrated, cameras, placements)
        results = {
            name: _residuals(camera, poses[name])
            for name, camera in cameras.items()
            if camera.views
        }
    image = torch.cat([residual.image for residual in results.values()])
    board = torch.cat([residual.board for residual in results.values()])
    views = np.concatenate(list(placements.of_views.values()))
    counts = np.bincount(views, minlength=placements.count)
    return RigEvaluation(
        rms_px=Residuals(image, board).rms_px,
        cameras={name: residual.rms_px for name, residual in results.items()},
        placements=placements.count,
        shared_placements=int((counts > 1).sum()),
        lengths=_length_bands(calibrated, cameras, placements),
        rejected=tuple(rejected),
    )


def _read(
    rig: Rig, description: RigDescription, name: str, progress: Progress
) -> tuple[_HeldOut, list[tuple[str, str]]]:
    """Return a camera's views with their poses, and the pictures that are left out."""
    session = description.sessions[name]
    if name not in rig.calibrations:
        raise InputError(
            f"{description.file}: cameras has {brief(repr(name))}, and the calibrated rig has"
            f" {', '.join(rig.names)}: name the held-out cameras as these."
        )
    calibration = rig.calibrations[name]
    size = session.camera.width, session.camera.height
    camera = calibration.camera
    if size != (camera.width, camera.height):
        raise InputError(
            f"{session.path} is of {size[0]}x{size[1]} px and the calibration of {name} for"
            f" {camera.width}x{camera.height}: evaluate with pictures of the calibrated camera"
            " mode."
        )
    if session.board != calibration.board:
        raise InputError(
            f"{session.path} has a {session.board} board and the calibrated rig a"
            f" {calibration.board} one: evaluate with pictures of the same board."
        )
    views, rejected = read_views(session, progress)
    views, unusable = split_usable_views(views, session.board)
    path, values = calibration.model()
    views, poses, poseless = with_initial_pose(path, values, views, session.board)
    if views:
        observations = Observations.of(views, session.board)
        with single_thread():
            poses, _ = refit_poses(path, values, observations, poses)
    dropped = [(r.name, r.reason) for r in (*rejected, *unusable, *poseless)]
    return _HeldOut(calibration, views, poses), dropped


def _mounting(rig: Rig, name: str) -> Tensor:
    return torch.from_numpy(rig.mountings[rig.names.index(name)])


def _renumbered(
    rig: Rig, cameras: Mapping[str, _HeldOut], placements: Placements
) -> dict[str, _HeldOut]:
    """Return the views with their corners in the order of the first camera that saw the same
    placement.
    """
    placed = torch.full((placements.count, 6), torch.nan, dtype=torch.float64)
    renumbered = {}
    for name, camera in cameras.items():
        place = torch.from_numpy(placements.of_views[name])
        mounting = _mounting(rig, name)
        board = camera.calibration.board
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


def _fit_placements(
    rig: Rig, cameras: Mapping[str, _HeldOut], placements: Placements
) -> dict[str, Tensor]:
    """Return the (V, 6) poses of each camera's views from one placement for all cameras."""
    problems = []
    start = torch.full((placements.count, 6), torch.nan, dtype=torch.float64)
    used = [name for name, camera in cameras.items() if camera.views]
    for name in used:
        camera = cameras[name]
        path, values = camera.calibration.model()
        observations = Observations.of(camera.views, camera.calibration.board)
        _, failure = path.land(observations.pixels, values, camera.poses[observations.view], MIDDLE)
        observations = observations.select_rows(failure == 0)
        weights = pixel_weights(path, values, observations, camera.poses, 1.0)
        parameters = Parameters.none(values)
        blocks = tuple(make_residual_blocks(path, parameters, observations, weights))
        empty = torch.zeros(0, dtype=torch.int64)
        mounting = _mounting(rig, name)
        place = torch.from_numpy(placements.of_views[name])
        landing = LandingProblem(
            parameters, blocks, weights.new_zeros(0, 0), view_precision(path, camera.poses)
        )
        problems.append(CameraProblem(landing, empty, mounting, empty, place))
        placed_poses = compose(invert_poses(mounting), camera.poses)
        is_new = start[place, 0].isnan()
        start[place[is_new]] = placed_poses[is_new]
    problem = RigProblem(tuple(problems), start.new_zeros(0, 0))
    solution = minimise(problem, start.new_zeros(0), start)
    return {
        name: camera.compose(solution.shared, solution.blocks)
        for name, camera in zip(used, problems, strict=True)
    }


def _residuals(camera: _HeldOut, poses: Tensor) -> Residuals:
    path, values = camera.calibration.model()
    observations = Observations.of(camera.views, camera.calibration.board)
    return residuals(path, values, observations, poses)


def _length_bands(
    rig: Rig, cameras: Mapping[str, _HeldOut], placements: Placements
) -> tuple[LengthBand, ...]:
    """Return the errors of the lengths between the ends of the board's rows, columns and diagonals,
    by their depth.
    """
    board = next(iter(rig.calibrations.values())).board
    pixels = {
        name: np.full((placements.count, board.count, 2), np.nan) for name in rig.calibrations
    }
    for name, camera in cameras.items():
        for place, view in zip(placements.of_views[name], camera.views, strict=True):
            pixels[name][place] = np.where(view.seen[:, None], view.corners, np.nan)
    ends = _length_ends(board)
    pairs = ends + board.count * np.arange(placements.count)[:, None, None]
    flat = {name: corners.reshape(-1, 2) for name, corners in pixels.items()}
    noise_px = float(np.sqrt(np.mean([_noise(c) ** 2 for c in rig.calibrations.values()])))
    length, sigma = rig.distances(flat, pairs.reshape(-1, 2), noise_px)
    points = _points(rig, flat, pairs.reshape(-1, 2))
    depth = points.mean(1)[:, 2]
    true = np.tile(_true_lengths(rig, ends), placements.count)
    error = length - true
    measured = np.isfinite(error)
    if not measured.any():
        return ()
    edges = [0.0, FIRST_BAND_END]
    while edges[-1] <= depth[measured].max():
        edges.append(2 * edges[-1])
    bands = []
    for low, high in pairwise(edges):
        members = measured & (depth >= low) & (depth < high)
        if members.any():
            bands.append(
                LengthBand(
                    from_m=low,
                    to_m=high,
                    rms_mm=1000 * _rms(error[members]),
                    sigma_mm=1000 * _rms(sigma[members]),
                    normalised=_rms(error[members] / sigma[members]),
                    lengths=int(members.sum()),
                )
            )
    return tuple(bands)


def _points(rig: Rig, pixels: Mapping[str, Array], pairs: Indices) -> Array:
    """Return the (M, 2, 3) m ends of the pairs."""
    chosen, places = np.unique(pairs, return_inverse=True)
    points, _ = rig.triangulate({name: camera[chosen] for name, camera in pixels.items()})
    return points[places.reshape(pairs.shape)]


def _length_ends(board: Board) -> Indices:
    """Return the (L, 2) corners at the ends of the rows, columns and diagonals."""
    corners = np.arange(board.count).reshape(board.rows, board.columns)
    rows = corners[:, [0, -1]]
    columns = corners[[0, -1]].T
    diagonals = np.array([[corners[0, 0], corners[-1, -1]], [corners[0, -1], corners[-1, 0]]])
    return np.concatenate([rows, columns, diagonals])


def _true_lengths(rig: Rig, ends: Indices) -> Array:
    """Return the (L,) m lengths on the board, with its shape and print as the rig's fit has
    them.
    """
    calibration = rig.calibrations[rig.reference]
    path, values = calibration.model()
    corners = torch.from_numpy(calibration.board.points())
    pose = torch.zeros(len(corners), 6, dtype=torch.float64)
    points = path.place(corners, values, pose, MIDDLE).numpy()
    lengths: Array = np.linalg.norm(points[ends[:, 1]] - points[ends[:, 0]], axis=-1)
    return lengths


def _noise(calibration: Calibration) -> float:
    """Return the noise of a corner's coordinate, px."""
    joint = calibration.outcome.joint
    if joint:
        return joint.sigma_px
    return calibration.stages[-1].rms_px / 2**0.5


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
