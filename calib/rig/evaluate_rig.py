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

from calib.corners.copies import count_fitted
from calib.errors import NotEnoughDataError
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals, residuals
from calib.fitting.evaluate import FIRST_BAND_END, alternate_rows
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
    rig: RigCalibrationSource,
    source: RigSource,
    progress: Progress = Silent(),
    *,
    halves: bool = False,
) -> RigEvaluation:
    """Refit the placements of a rig's held-out pictures, with the cameras and mountings of a
    calibrated rig, and measure the residual and the lengths on the board.

    Args:
        rig: the calibrated rig, or the path of its folder.
        source: the held-out pictures: a rig.yaml whose cameras are some of the rig's.
        progress: the progress bars.
        halves: measure each half of a placement's corners with the pose that the other half gives.
            This is always done if the board bends differently in every placement.

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
        placed = _placed_views(calibrated, cameras, placements)
        start = first_placements(
            [views.mounting for views in placed.values()],
            [cameras[name].poses for name in placed],
            [views.placement for views in placed.values()],
            placements.count,
        )
        fitted, results = _measure(calibrated, placed, start, halves=halves)
    image = torch.cat([residual.image for residual in results.values()])
    board = torch.cat([residual.board for residual in results.values()])
    views = np.concatenate(list(placements.of_views.values()))
    counts = np.bincount(views, minlength=placements.count)
    return RigEvaluation(
        rms_px=Residuals(image, board).rms_px,
        cameras={name: residual.rms_px for name, residual in results.items()},
        placements=placements.count,
        shared_placements=int((counts > 1).sum()),
        lengths=_length_bands(calibrated, cameras, placements, fitted),
        rejected=tuple(rejected),
        views=sum(len(camera.views) for camera in cameras.values()),
        fitted_views=sum(
            count_fitted(camera.views, calibrated.calibrations[name].views)
            for name, camera in cameras.items()
        ),
    )


def _placed_views(
    rig: Rig, cameras: Mapping[str, LaterViews], placements: Placements
) -> dict[str, PlacedViews]:
    """Return the views of each camera that has any, at its mounting."""
    placed = {}
    for name, camera in cameras.items():
        if camera.views:
            path, values = camera.calibration.model()
            observations = Observations.of(camera.views, camera.board)
            place = torch.from_numpy(placements.of_views[name])
            placed[name] = PlacedViews(path, values, observations, mounting_of(rig, name), place)
    return placed


def _measure(
    rig: Rig, placed: Mapping[str, PlacedViews], start: Tensor, *, halves: bool
) -> tuple[Tensor, dict[str, Residuals]]:
    """Return the (P, B) placements that fit best, with one pose of the board for all cameras, and
    the residuals of each camera.

    Args:
        start: (P, 6) placements to start from.
        halves: measure half of the corners with the pose and the bend that the other half of all
            cameras gives, even if the board does not bend.
    """
    views = tuple(placed.values())
    bends = views[0].path.has_private_blocks
    noise = np.array([rig.calibrations[name].corner_sigma_px for name in placed])
    # Without bends there is no prior that the noise weighs.
    sigma = _rms(noise) if bends else 1.0
    fitted = fit_placements(views, start, sigma)
    if not (halves or bends):
        return fitted, {name: _residuals(camera, fitted) for name, camera in placed.items()}
    odd = {name: alternate_rows(camera.observations) for name, camera in placed.items()}
    of_odd = [_rows_of(camera, odd[name]) for name, camera in placed.items()]
    of_even = [_rows_of(camera, ~odd[name]) for name, camera in placed.items()]
    by_odd = fit_placements(of_odd, fitted, sigma)
    by_even = fit_placements(of_even, fitted, sigma)
    return fitted, {
        name: _joined(odd[name], _residuals(camera, by_even), _residuals(camera, by_odd))
        for name, camera in placed.items()
    }


def _rows_of(views: PlacedViews, rows: Tensor) -> PlacedViews:
    """Return the views with the corners of an (M,) mask."""
    return replace(views, observations=views.observations.select_rows(rows))


def _joined(chosen: Tensor, first: Residuals, second: Residuals) -> Residuals:
    """Return the first residuals where (M,) `chosen` is true, and the second ones elsewhere."""
    rows = chosen[:, None]
    return Residuals(
        torch.where(rows, first.image, second.image), torch.where(rows, first.board, second.board)
    )


def _residuals(views: PlacedViews, placements: Tensor) -> Residuals:
    return residuals(views.path, views.values, views.observations, views.poses(placements))


def _length_bands(
    rig: Rig, cameras: Mapping[str, LaterViews], placements: Placements, fitted: Tensor
) -> tuple[LengthBand, ...]:
    """Return the errors of the lengths between the ends of the board's rows, columns and diagonals,
    by their depth; none of a target of points, of which no two cameras see the same.

    Args:
        fitted: (P, B) the placements, with the bends of the board.
    """
    board = next(iter(rig.calibrations.values())).board
    if not board.has_grid:
        return ()
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
    true = _true_lengths(rig, ends, fitted)
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


def _true_lengths(rig: Rig, ends: Indices, fitted: Tensor) -> Array:
    """Return the (P * L,) m lengths on the board of each placement, with its shape and print as the
    rig's fit has them, and its bend in this placement.
    """
    calibration = rig.calibrations[rig.reference]
    path, values = calibration.model()
    corners = torch.from_numpy(calibration.board.points())
    poses = torch.cat([torch.zeros_like(fitted[:, :6]), fitted[:, 6:]], 1)
    count = len(poses)
    placed = poses.repeat_interleave(len(corners), 0)
    points = path.place(corners.repeat(count, 1), values, placed, MIDDLE).numpy()
    points = points.reshape(count, len(corners), 3)
    lengths: Array = np.linalg.norm(points[:, ends[:, 1]] - points[:, ends[:, 0]], axis=-1)
    return lengths.ravel()


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
