"""A second look at the pictures, led by the fitted model: corners that it puts inside the picture,
and that were not found, are looked for.

They are looked for ring after ring around those that were seen, so that what covers the rest of the
board never outnumbers its corners, and are taken where the patch looks like a corner and lies where
the model and its neighbours say. The view is then measured as a whole, its edges bent as the model
says. A view in which nothing new is found is left as it is, to the last digit.

A corner that was seen is not dropped for lying far from the model's place: glass, board or shutter
may have put it there, and the diagnosis is to find out.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath

import numpy as np
import torch
from numpy.typing import NDArray

from calib.corners.lattice import Lattice, lattice_step
from calib.corners.measure import MeasuredCorners, measure_corners
from calib.corners.view import View
from calib.corners.weights import weigh_views
from calib.fitting.stages import Fitted
from calib.io.images import read_grey
from calib.optics.projection import project
from calib.progress import Progress
from calib.session.board import Board

Floats = NDArray[np.float64]

LOOKS = "second_look"
"""Of a calibration's settings: what was looked for in which picture."""
RIM = 3.0  # px of the picture, where no corner is looked for
BESIDE = 1.5  # squares or tags: the ring around what was seen
NEIGHBOURS = 4  # corners, that say by how much the model is off there
# times what the model leaves of the view's other corners: no corner is further from where it is
# expected
FAR = 5.0
LEAST_FAR = 0.5  # px: nor a good view's than that


@dataclass(frozen=True, slots=True)
class SecondLook:
    """What one picture still had."""

    file: str
    found: int
    """Corners that were not seen before."""
    refused: int
    """Corners that the model puts inside the picture, and that do not look like corners there, or
    have none beside them that does.
    """
    dropped: int
    """Corners that were seen before, and do not look like corners where the model says how their
    edges run.
    """


def summed(looks: Sequence[SecondLook]) -> str:
    """One line, or none where nothing was looked for."""
    said = (
        ("found", "found where the model puts them"),
        ("refused", "are covered, or do not look like corners where the model puts them"),
        ("dropped", "dropped, as they do not look like corners after all"),
    )
    counts = [
        (sum(found := [getattr(look, name) for look in looks]), sum(map(bool, found)), what)
        for name, what in said
    ]
    parts = [
        f"{count} in {views} view{'s' * (views > 1)} {what}"
        for count, views, what in counts
        if count
    ]
    return f"Second look for corners: {'; '.join(parts)}." if parts else ""


def look_again(
    fitted: Fitted,
    views: Sequence[View],
    board: Board,
    frames: Sequence[FilePath],
    size: tuple[int, int],
    progress: Progress,
) -> tuple[tuple[View, ...], tuple[SecondLook, ...]]:
    """The views with what else their pictures show, and what was looked for in which.

    Args:
        fitted: to these views.
        frames: the views' pictures, and others.
        size: their width and height, px.
    """
    paths = {path.name: path for path in frames}
    again, looks = list(views), []
    left = {
        index: wanted
        for index, view in enumerate(views)
        if view.name in paths
        and not view.seen.all()
        and (wanted := ~view.seen & _inside(fitted, index, board, size)).any()
    }
    advance = progress.task("Second look", len(left)) if left else None
    for done, (index, wanted) in enumerate(left.items()):
        expected = _expected(fitted, index, board, [(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1)])
        again[index], look = _looked(
            views[index], wanted, expected, board, paths[views[index].name]
        )
        looks.append(look)
        if advance:
            advance(done + 1, f"{sum(one.found for one in looks)} corners found")
    return (weigh_views(again) if any(look.found for look in looks) else tuple(views)), tuple(looks)


def _inside(fitted: Fitted, view: int, board: Board, size: tuple[int, int]) -> NDArray[np.bool_]:
    """(count,) whether the model puts a corner inside the picture."""
    (places,) = _expected(fitted, view, board, [(0, 0)]).swapaxes(0, 1)
    return np.asarray(((places >= RIM) & (places <= np.array(size) - 1 - RIM)).all(1))


def _expected(fitted: Fitted, view: int, board: Board, beside: Sequence[tuple[int, int]]) -> Floats:
    """(count, K, 2) px: where the model sees what is so many half steps along x and y from each
    corner.
    """
    places = board.points()[:, None] + lattice_step(board) / 2 * np.array(beside)
    points = torch.from_numpy(places.reshape(-1, 2))
    placed = fitted.path.place(points, fitted.values, fitted.poses[view].expand(len(points), -1))
    return project(fitted.path, fitted.values, placed).numpy().reshape(places.shape)


def _looked(
    view: View, wanted: NDArray[np.bool_], expected: Floats, board: Board, picture: FilePath
) -> tuple[View, SecondLook]:
    known = np.isfinite(expected).all((1, 2))
    kept, left = view.seen & known, wanted & known
    corners = np.where(kept[:, None], view.corners, np.nan)
    if kept.sum() < NEIGHBOURS:
        return view, SecondLook(view.name, 0, int(wanted.sum()), 0)
    grey = read_grey(picture)
    far = max(
        LEAST_FAR, FAR * float(np.median(np.linalg.norm((corners - expected[:, 0])[kept], axis=1)))
    )
    while (ring := left & _beside(np.isfinite(corners[:, 0]), board)).any():
        start = _started(corners, expected[:, 0], ring, board)
        measured = _measured(grey, start, expected, board)
        new = ring & (np.linalg.norm(measured.corners - start, axis=1) <= far)  # never of NaN
        corners[new] = measured.corners[new]
        left &= ~ring
    found = np.isfinite(corners[:, 0]) & ~kept
    if not found.any():
        return view, SecondLook(view.name, 0, int(wanted.sum()), 0)
    last = _measured(grey, corners, expected, board)
    seen = np.isfinite(last.corners[:, 0])
    unknown = (view.seen & ~known)[:, None]  # the model does not say how their edges run
    covariances = (
        view.covariance if view.covariance is not None else np.full_like(last.covariances, np.nan)
    )
    again = replace(
        view,
        corners=np.where(unknown, view.corners, last.corners),
        weight=(seen | unknown[:, 0]).astype(np.float64),
        covariance=np.where(unknown[..., None], covariances, last.covariances),
    )
    return again, SecondLook(
        view.name, int((seen & found).sum()), int((wanted & ~seen).sum()), int((kept & ~seen).sum())
    )


def _measured(grey: NDArray, start: Floats, expected: Floats, board: Board) -> MeasuredCorners:
    """From (count, 2) px, NaN where not to be measured, with edges as the model has them."""
    rows = np.isfinite(start[:, 0])
    own = expected[rows]
    lattice = Lattice.from_model(own[:, 0], own[:, 1:3], own[:, 3:5], board)
    return measure_corners(grey, start, board, replace(lattice, corners=start[rows]))


def _beside(seen: NDArray[np.bool_], board: Board) -> NDArray[np.bool_]:
    """(count,) whether a corner is next to a seen one."""
    points = board.points()
    return np.asarray(
        np.linalg.norm(points[:, None] - points[seen], axis=-1).min(1) <= BESIDE * board.square
    )


def _started(corners: Floats, expected: Floats, ring: NDArray[np.bool_], board: Board) -> Floats:
    """(count, 2) px, those of the ring where the model puts them, moved as their nearest neighbours
    are.
    """
    seen = np.flatnonzero(np.isfinite(corners[:, 0]))
    points = board.points()
    start = corners.copy()
    for corner in np.flatnonzero(ring).tolist():
        near = seen[
            np.argsort(np.linalg.norm(points[seen] - points[corner], axis=1), kind="stable")[
                :NEIGHBOURS
            ]
        ]
        start[corner] = expected[corner] + (corners[near] - expected[near]).mean(0)
    return start
