"""Evaluate a rig on held-out placements of the board: one pose for all cameras, and lengths on the
board against the truth.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.copies import count_fitted
from calib.errors import NotEnoughDataError
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals, residuals
from calib.fitting.evaluate import FIRST_BAND_END
from calib.optics.exposure import MIDDLE
from calib.progress import Progress, Silent, check_progress
from calib.rig.later_views import (
    LaterViews,
    PlacedViews,
    first_placements,
    fit_placements,
    mounting_of,
    read_later_views,
    renumber_views,
)
from calib.rig.placements import Indices, Placements
from calib.rig.rig import Rig, RigCalibrationSource
from calib.rig.rig_content import RejectedView
from calib.rig.rig_file import RigSource, read_rig
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
    placements: int
    """The placements of the board with these lengths."""


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
    views: int = 0
    """The views of all cameras."""
    fitted_views: int = 0
    """Those of them that the rig was fitted to, which are no test of it."""


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
    calibrated = Rig.of(rig)
    description = read_rig(source)
    rejected: list[RejectedView] = []
    cameras: dict[str, LaterViews] = {}
    for name in description.sessions:
        held_out, dropped = read_later_views(calibrated, description, name, progress)
        rejected += [RejectedView(name, picture, reason) for picture, reason in dropped]
        cameras[name] = held_out
    if not any(camera.views for camera in cameras.values()):
        raise NotEnoughDataError(
            f"{description.file} has no picture to evaluate with: take pictures that show the whole"
            " board."
        )
    placements = Placements.of(description, {name: c.views for name, c in cameras.items()})
    with single_thread():
        cameras = renumber_views(calibrated, cameras, placements)
        poses = _fit_poses(calibrated, cameras, placements)
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
        views=sum(len(camera.views) for camera in cameras.values()),
        fitted_views=sum(
            count_fitted(camera.views, calibrated.calibrations[name].views)
            for name, camera in cameras.items()
        ),
    )


def _fit_poses(
    rig: Rig, cameras: Mapping[str, LaterViews], placements: Placements
) -> dict[str, Tensor]:
    """Return the (V, 6) poses of each camera's views from one placement for all cameras."""
    placed = {}
    for name, camera in cameras.items():
        if camera.views:
            path, values = camera.calibration.model()
            observations = Observations.of(camera.views, camera.calibration.board)
            place = torch.from_numpy(placements.of_views[name])
            placed[name] = PlacedViews(path, values, observations, mounting_of(rig, name), place)
    start = first_placements(
        [views.mounting for views in placed.values()],
        [cameras[name].poses for name in placed],
        [views.placement for views in placed.values()],
        placements.count,
    )
    fitted = fit_placements(tuple(placed.values()), start)
    return {name: views.poses(fitted) for name, views in placed.items()}


def _residuals(camera: LaterViews, poses: Tensor) -> Residuals:
    path, values = camera.calibration.model()
    observations = Observations.of(camera.views, camera.calibration.board)
    return residuals(path, values, observations, poses)


def _length_bands(
    rig: Rig, cameras: Mapping[str, LaterViews], placements: Placements
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
    noise_px = _rms(np.array([c.corner_sigma_px for c in rig.calibrations.values()]))
    length, sigma = rig.distances(flat, pairs.reshape(-1, 2), noise_px)
    points = _points(rig, flat, pairs.reshape(-1, 2))
    depth = points.mean(1)[:, 2]
    true = np.tile(_true_lengths(rig, ends), placements.count)
    of_length = np.repeat(np.arange(placements.count), len(ends))
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
                    placements=len(np.unique(of_length[members])),
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


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
