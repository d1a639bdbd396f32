"""Detect corners again, guided by the fitted model: look for the corners that the model predicts
inside a picture and that the first detection lacks.

The search proceeds ring by ring around the detected corners, so that an object in front of the
board never outnumbers its corners. A corner is accepted if its patch looks like a corner and lies
where the model and its neighbours predict it. Then all corners of the view are measured anew, with
the curved edges that the model predicts. A view without a new corner stays the same to the last
digit.

A detected corner is not dropped because it lies far from its prediction: glass, board or shutter
may have moved it, which is for the diagnosis to find out.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path as FilePath

import numpy as np
import torch
from numpy.typing import NDArray

from calib.corners.lattice import Lattice, lattice_step
from calib.corners.measure import MeasuredCorners, measure_corners
from calib.corners.view import View
from calib.corners.weights import weigh_views
from calib.fit_record.outcome import Redetection
from calib.fitting.fitted import Fitted
from calib.io.images import read_grey
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.progress import Progress
from calib.session.board import Board
from calib.session.coding import AprilGrid

Floats = NDArray[np.float64]

PICTURE_MARGIN = 3.0
"""px along the picture's edge in which no corner is looked for."""
RING_WIDTH = 1.5
"""Squares or tags from a detected corner to the corners of the next ring."""
NEIGHBOURS = 4
"""Corners whose mean residual corrects the prediction of a corner next to them."""
MAX_RESIDUAL_RATIO = 5.0
"""Times the median residual of the view's detected corners: a new corner may be this far from its
prediction.
"""
MIN_TOLERANCE = 0.5
"""px: the least distance from its prediction that a new corner may have, however good the view is.
"""


def describe_redetection(redetections: Sequence[Redetection]) -> str:
    """Return one line about all pictures; empty if nothing was looked for."""
    columns = (
        ([row.new_corners for row in redetections], "found where the model puts them"),
        (
            [row.refused for row in redetections],
            "are covered, or do not look like corners where the model puts them",
        ),
        (
            [row.dropped for row in redetections],
            "dropped, as they do not look like corners after all",
        ),
    )
    phrases = []
    for counts, text in columns:
        views = sum(map(bool, counts))
        if views:
            phrases.append(f"{sum(counts)} in {views} view{'s' * (views > 1)} {text}")
    return f"Second look for corners: {'; '.join(phrases)}." if phrases else ""


def redetect_corners(
    fitted: Fitted,
    views: Sequence[View],
    board: Board,
    frames: Sequence[FilePath],
    size: tuple[int, int],
    progress: Progress,
) -> tuple[tuple[View, ...], tuple[Redetection, ...]]:
    """Return the views with the corners that the search adds, and its result for each picture.

    Args:
        fitted: the fit to these views.
        frames: the pictures of the views, and possibly more.
        size: width and height of a picture, px.
    """
    if isinstance(board.coding, AprilGrid) and not board.coding.crossings:
        return tuple(views), ()  # a corner without its tag's outline cannot be measured
    paths = {path.name: path for path in frames}
    updated, redetections = list(views), []
    wanted_corners = {
        index: wanted
        for index, view in enumerate(views)
        if view.name in paths
        and not view.seen.all()
        and (wanted := ~view.seen & _inside(fitted, index, board, size)).any()
    }
    advance = progress.task("Second look", len(wanted_corners)) if wanted_corners else None
    for done, (index, wanted) in enumerate(wanted_corners.items()):
        expected = _expected(fitted, index, board, [(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)])
        updated[index], redetection = _redetect_view(
            views[index], wanted, expected, board, paths[views[index].name]
        )
        redetections.append(redetection)
        if advance:
            advance(done + 1, f"{sum(row.new_corners for row in redetections)} corners found")
    has_new_corners = any(row.new_corners for row in redetections)
    return (weigh_views(updated) if has_new_corners else tuple(views)), tuple(redetections)


def _inside(fitted: Fitted, view: int, board: Board, size: tuple[int, int]) -> NDArray[np.bool_]:
    """Return a (count,) mask of the corners that the model predicts inside the picture."""
    places = _expected(fitted, view, board, [(0, 0)])[:, 0]
    last = np.array(size) - 1 - PICTURE_MARGIN
    return np.asarray(((places >= PICTURE_MARGIN) & (places <= last)).all(1))


def _expected(fitted: Fitted, view: int, board: Board, steps: Sequence[tuple[int, int]]) -> Floats:
    """Return the (count, K, 2) px at which the model sees the board points that lie K `steps`, in
    half lattice steps along x and y, from each corner.
    """
    places = board.points()[:, None] + lattice_step(board) / 2 * np.array(steps)
    points = torch.from_numpy(places.reshape(-1, 2))
    poses = fitted.poses[view].expand(len(points), -1)
    placed = fitted.path.place(points, fitted.values, poses, MIDDLE)
    return project(fitted.path, fitted.values, placed, MIDDLE).numpy().reshape(places.shape)


def _redetect_view(
    view: View, wanted: NDArray[np.bool_], expected: Floats, board: Board, picture: FilePath
) -> tuple[View, Redetection]:
    predicted = np.isfinite(expected).all((1, 2))
    detected = view.seen & predicted
    remaining = wanted & predicted
    corners = np.where(detected[:, None], view.corners, np.nan)
    unchanged = Redetection(view.name, 0, int(wanted.sum()), 0)
    if detected.sum() < NEIGHBOURS:
        return view, unchanged
    grey = read_grey(picture)
    residuals = np.linalg.norm((corners - expected[:, 0])[detected], axis=1)
    tolerance = max(MIN_TOLERANCE, MAX_RESIDUAL_RATIO * float(np.median(residuals)))
    while (ring := remaining & _adjacent(np.isfinite(corners[:, 0]), board)).any():
        start = _corrected_predictions(corners, expected[:, 0], ring, board)
        measured = _measure(grey, start, expected, board)
        # false for NaN
        accepted = ring & (np.linalg.norm(measured.corners - start, axis=1) <= tolerance)
        corners[accepted] = measured.corners[accepted]
        remaining &= ~ring
    new_corners = np.isfinite(corners[:, 0]) & ~detected
    if not new_corners.any():
        return view, unchanged
    final = _measure(grey, corners, expected, board)
    visible = np.isfinite(final.corners[:, 0])
    unpredicted = view.seen & ~predicted  # the direction of their edges is unknown
    updated = replace(
        view,
        corners=_restore(final.corners, view.corners, unpredicted),
        weight=(visible | unpredicted).astype(np.float64),
        covariance=_restore(final.covariances, view.covariance, unpredicted),
        blur=_restore(final.blurs, view.blur, unpredicted),
    )
    return updated, Redetection(
        file=view.name,
        new_corners=int((visible & new_corners).sum()),
        refused=int((wanted & ~visible).sum()),
        dropped=int((detected & ~visible).sum()),
    )


def _restore(measured: Floats, earlier: Floats | None, rows: NDArray[np.bool_]) -> Floats:
    """Return the measured values with the earlier ones in these rows, NaN if there are none."""
    restored = measured.copy()
    restored[rows] = np.nan if earlier is None else earlier[rows]
    return restored


def _measure(grey: NDArray, start: Floats, expected: Floats, board: Board) -> MeasuredCorners:
    """Measure corners from `start`, (count, 2) px, NaN where a corner is not to be measured, with
    the edges of the model.
    """
    rows = np.isfinite(start[:, 0])
    places = expected[rows]
    lattice = Lattice.from_model(places[:, 0], places[:, 1:3], places[:, 3:5], board)
    return measure_corners(grey, start, board, replace(lattice, corners=start[rows]))


def _adjacent(detected: NDArray[np.bool_], board: Board) -> NDArray[np.bool_]:
    """Return a (count,) mask of the corners that are next to a detected one."""
    points = board.points()
    distances = np.linalg.norm(points[:, None] - points[detected], axis=-1)
    return np.asarray(distances.min(1) <= RING_WIDTH * board.square)


def _corrected_predictions(
    corners: Floats, expected: Floats, ring: NDArray[np.bool_], board: Board
) -> Floats:
    """Return the (count, 2) px `corners` with those of the ring at their prediction, shifted by the
    mean residual of their nearest neighbours.
    """
    detected = np.flatnonzero(np.isfinite(corners[:, 0]))
    points = board.points()
    start = corners.copy()
    for corner in np.flatnonzero(ring).tolist():
        distances = np.linalg.norm(points[detected] - points[corner], axis=1)
        neighbours = detected[np.argsort(distances, kind="stable")[:NEIGHBOURS]]
        start[corner] = expected[corner] + (corners[neighbours] - expected[neighbours]).mean(0)
    return start
