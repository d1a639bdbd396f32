"""What the views say of the camera so far, and where to hold the board next. Pure: arrays in, a
hint out.

Two guides: the plain one looks at the picture alone, and serves where torch is absent or still
    loading; the informed one knows what each
pose would tell of this very camera and cover (calib.planning.design, computed in a process of its
own).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.planning.design import MAX_PLANNED_VIEWS, Design
from calib.planning.hints import placement_hint, tilt_of
from calib.planning.pose_bank import Reach, fit_bare_pose, make_pose_bank, outline
from calib.session.board import Board
from calib.session.camera import Camera
from capture.gate import new
from capture.sighting import Sighting

Array = NDArray[np.float64]

TARGET = 0.1  # px, the predicted sigma of the undistorted position that is enough
CELLS = (9, 12)  # rows and columns of the coverage maps
FINE = 16  # samples across a cell, for the part of it that a board covers
ASKED = {"cell": 1.0, "depth": 4.0, "side": 2.0, "over": 2.0}
"""Views: the plain rule wants so many for each cell, depth, side tilted away, and border that the
board reaches over, if it can.
"""
ENOUGH = 0.1  # what a further view may still be worth when the plain rule is content
# of the picture's width: how far off a corner counts that one of two views has, and the other has
# not
ELSEWHERE = 0.25
# a board over a quarter of the picture counts as much to the plain rule as a new depth or a new
# tilt
CELLS_WORTH = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class SeenView:
    """A view that was kept."""

    corners: Array
    """(count, 2) px, NaN where not seen."""
    pose: Array | None = None
    """(6,) T_camera_board, rotation vector (rad) and translation (m); None: as the bare camera
    would see it.
    """


@dataclass(frozen=True, slots=True, eq=False)
class Hint:
    """Where to hold the board next."""

    outline: Array
    """(N, 2) px, the polygon through the board's outermost corners; a board with markers may reach
    out of the picture.
    """
    pose: Array
    """(6,) rotation vector (rad) and translation (m)."""
    words: str
    """closer, to the left edge, tilt the right side away"""


@dataclass(frozen=True, slots=True, eq=False)
class SessionProgress:
    """How far the session is."""

    enough: bool
    sentence: str
    sigma_px: float | None
    """The predicted standard deviation of the undistorted position, over the picture and the
    session's depths; None: not known.
    """
    views_needed: int | None
    """How many more views are likely needed; 0 if none are; None: not known."""
    image: Array
    """(h, w) coverage of the picture, 0 to 1."""
    depth: Array
    """(n,) coverage of the depths, near to far, 0 to 1."""
    glass: Array
    """(h, w) coverage of the patch of glass that the picture looks through, 0 to 1; rows along the
    cover, columns around it.
    """


class Guide(Protocol):
    """Says where to hold the board, and when it is enough."""

    def next_pose(self, views: Sequence[SeenView]) -> Hint | None:
        """The pose to take next; None if no pose would help."""
        ...

    def progress(self, views: Sequence[SeenView]) -> SessionProgress: ...


class PlainGuide:
    """Boards over the whole picture, at every depth, tilted each way: a rule that knows nothing of
    the cover.
    """

    def __init__(self, board: Board, camera: Camera, reach: Reach | None = None) -> None:
        """
        Args:
            camera: without intrinsics, a usual lens is assumed.
            reach: None: what the board's size allows.
        """
        self._board, self._camera = board, camera
        self._reach = reach or Reach.of(board, camera)
        self._bank = make_pose_bank(board, camera, self._reach)
        self._covered = np.array(
            [
                self._covers(SeenView(*view))
                for view in zip(self._bank.corners, self._bank.poses, strict=True)
            ]
        )
        cells, levels = CELLS[0] * CELLS[1], len(self._reach.levels())
        self._asked = np.repeat(list(ASKED.values()), (cells, levels, 4, 4)) * self._covered.any(
            0
        )  # no checkerboard fills the outermost cells
        self._worth = np.repeat((CELLS_WORTH / cells, 1.0, 1.0, 1.0), (cells, levels, 4, 4))

    def next_pose(self, views: Sequence[SeenView]) -> Hint | None:
        best = self._best(self._done(views))
        if best is None:
            return None
        return hint(
            self._bank.poses[best],
            self._bank.corners[best],
            views,
            self._board,
            self._camera,
            self._reach,
        )

    def progress(self, views: Sequence[SeenView]) -> SessionProgress:
        done = self._done(views)
        cells, levels = CELLS[0] * CELLS[1], len(self._reach.levels())
        share = np.where(self._asked > 0, np.minimum(done / np.maximum(self._asked, 1e-9), 1), 0.0)
        image, depth = share[:cells].reshape(CELLS), share[cells : cells + levels]
        needed = 0
        while (best := self._best(done)) is not None:
            done, needed = done + self._covered[best], needed + 1
        said = f"likely {needed} more view{'s' * (needed > 1)}" if needed else "enough"
        sentence = f"Judged by picture, depth and tilt: {said}."
        return SessionProgress(
            not needed, sentence, None, needed, image, depth, image
        )  # each pixel looks through its own point of the glass

    def _best(self, done: Array) -> int | None:
        """The pose that adds most of what is missing; None if nothing is."""
        gains = np.minimum(self._covered, np.maximum(self._asked - done, 0)) @ self._worth
        return int(gains.argmax()) if gains.max() > ENOUGH else None

    def _done(self, views: Sequence[SeenView]) -> Array:
        return (
            np.sum([self._covers(view) for view in views], axis=0)
            if views
            else np.zeros(len(self._asked))
        )

    def _covers(self, view: SeenView) -> Array:
        """The part of each cell, then one for the view's depth, for each side that is away and for
        each border that the board reaches over: left, right, top, bottom.
        """
        levels = self._reach.levels()
        pose = pose_of(view, self._board, self._camera)
        depth, sides = np.zeros(len(levels)), np.zeros(4)
        if pose is not None:
            across, down = tilt_of(pose)
            depth[np.abs(1 / levels - 1 / pose[5]).argmin()] = 1
            sides[:] = across < 0, across > 0, down < 0, down > 0
        over, around = np.zeros(4), outline(view.corners, self._board)
        over[::2], over[1::2] = (
            around.min(0) < 0,
            around.max(0)
            > (
                self._camera.width - 1,
                self._camera.height - 1,
            ),
        )
        return np.concatenate(
            [
                covered_cells(seen_outline(view.corners, self._board), self._camera).ravel(),
                depth,
                sides,
                over,
            ]
        )


class InformedGuide:
    """The view that makes the maps surest comes next, and it is enough when they are sure enough
    and folds over the views agree.
    """

    def __init__(
        self,
        board: Board,
        camera: Camera,
        reach: Reach,
        design: Design,
        *,
        folds_agree: bool | None = None,
        target_px: float = TARGET,
    ) -> None:
        """
        Args:
            design: computed at the estimate from the first `design.views` views; views after these
                count as the nearest pose of the bank.
            folds_agree: whether views that a fit has not seen fit it as well; None: not tried yet.
            target_px: what sigma is wanted.
        """
        self._board, self._camera, self._reach = board, camera, reach
        self._design, self._folds_agree, self._target = design, folds_agree, target_px

    def next_pose(self, views: Sequence[SeenView]) -> Hint | None:
        best = self._design.plan(self._known(views), self._used(views), 0.0, limit=1)
        if not best:
            return None
        return hint(
            self._design.poses[best[0]],
            self._design.corners[best[0]],
            views,
            self._board,
            self._camera,
            self._reach,
        )

    def progress(self, views: Sequence[SeenView]) -> SessionProgress:
        known = self._known(views)
        variance = self._design.variance(known)  # (h, w, D)
        sigma = float(np.sqrt(np.nanmean(variance)))
        with_more = known + self._design.information[
            (plan := self._design.plan(known, self._used(views), self._target))
        ].sum(0)
        needed = len(plan) if self._design.sigma(with_more) <= self._target else None
        image, depth = (
            np.nan_to_num(np.minimum(self._target / root_mean(variance, axis), 1))
            for axis in (2, (0, 1))
        )
        return SessionProgress(
            needed == 0 and bool(self._folds_agree),
            self._sentence(sigma, needed),
            sigma,
            needed,
            image,
            depth,
            self._glass(views),
        )

    def _sentence(self, sigma: float, needed: int | None) -> str:
        said = f"The maps are likely off by {_px(sigma)} px; {_px(self._target)} are wanted"
        if needed is None:
            return (
                f"{said}, which {MAX_PLANNED_VIEWS} more views would not reach: take nearer and"
                " larger boards."
            )
        if needed:
            return f"{said}: likely {needed} more view{'s' if needed > 1 else ''}."
        if self._folds_agree is None:
            return f"{said}. Whether views left out of the fit agree is being computed."
        if not self._folds_agree:
            return (
                f"{said}, but views left out of the fit do not agree: take more, fit, then"
                " diagnose."
            )
        return f"Enough: {said.lower()}, and views left out of the fit agree."

    def _known(self, views: Sequence[SeenView]) -> Array:
        later = views[self._design.views :]
        return self._design.precision() + sum(
            (self._design.information[self._nearest(view)] for view in later), np.zeros(())
        )

    def _nearest(self, view: SeenView) -> int:
        apart = ((self._design.corners - upright(view.corners, self._board)) ** 2).sum(
            2
        )  # (P, count) px^2
        one, other = (
            np.isfinite(self._design.corners[..., 0]),
            np.isfinite(upright(view.corners, self._board)[:, 0]),
        )
        apart = np.where(
            one & other, apart, np.where(one | other, (ELSEWHERE * self._camera.width) ** 2, 0)
        )
        return int((apart.sum(1) / (one | other).sum(1)).argmin())

    def _used(self, views: Sequence[SeenView]) -> NDArray[np.bool_]:
        """(P,) which poses the gate would refuse, because there is such a view."""
        used, squares = np.zeros(len(self._design.poses), bool), self._squares()
        for view in views:
            corners = upright(view.corners, self._board)
            apart = ((self._design.corners - corners) ** 2).sum(
                2
            )  # (P, count) px^2, NaN where one of the two does not see the corner
            both = np.isfinite(apart).sum(1)
            for pose in np.flatnonzero((both > 0) & (np.nansum(apart, 1) < both * squares**2)):
                now = Sighting(
                    self._design.corners[pose],
                    self._camera.width,
                    self._camera.height,
                    0.0,
                    square=squares[pose],
                )
                used[pose] |= new(now, None, [corners]) is not None
        return used

    def _squares(self) -> Array:
        """(P,) px, the side of a square in each pose of the bank, on the mean."""
        grid = self._design.corners.reshape(-1, self._board.rows, self._board.columns, 2)
        steps = [
            np.linalg.norm(np.diff(grid, axis=axis), axis=-1).reshape(len(grid), -1)
            for axis in (2, 1)
        ]
        return np.asarray(np.nanmean(np.concatenate(steps, 1), 1))

    def _glass(self, views: Sequence[SeenView]) -> Array:
        """CELLS of the patch: the share of ASKED views that crossed it."""
        crossed = np.sum(
            [
                covered_cells(seen_outline(view.corners, self._board), self._camera)
                for view in views
            ],
            axis=0,
        )
        glass = np.zeros(CELLS)
        where = np.isfinite(self._design.glass[..., 0])
        row, column = (
            np.clip(self._design.glass[where] * CELLS, 0, np.array(CELLS) - 1).astype(int)
        ).T
        np.maximum.at(
            glass,
            (row, column),
            np.minimum(np.broadcast_to(crossed, CELLS)[where] / ASKED["cell"], 1),
        )
        return glass


def pose_of(view: SeenView, board: Board, camera: Camera) -> Array | None:
    """(6,) the view's pose, or what the bare camera would take for it; None where no pose shows
    these corners.
    """
    return fit_bare_pose(board, camera, view.corners) if view.pose is None else view.pose


def upright(corners: Array, board: Board) -> Array:
    """(count, 2) px of the same board in the order in which its columns run to the right, as in the
    bank.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    turns = [
        np.rot90(grid, quarter) for quarter in (range(4) if board.rows == board.columns else (0, 2))
    ]
    return max(turns, key=lambda turned: float(np.nansum(np.diff(turned[..., 0], axis=1)))).reshape(
        -1, 2
    )


def hint(
    pose: Array,
    corners: Array,
    views: Sequence[SeenView],
    board: Board,
    camera: Camera,
    reach: Reach,
) -> Hint:
    """In words as seen from the last view, where the person still stands."""
    present = pose_of(views[-1], board, camera) if views else None
    around = outline(corners, board)
    return Hint(
        around,
        pose,
        placement_hint(
            pose, around, (camera.width, camera.height), present, (reach.near, reach.far)
        ),
    )


def seen_outline(corners: Array, board: Board) -> Array:
    """(N, 2) px, around those of (count, 2) px that are seen."""
    seen = np.isfinite(corners[:, 0])
    if seen.all():
        return outline(corners, board)
    return np.asarray(cv2.convexHull(corners[seen].astype(np.float32)).reshape(-1, 2), np.float64)


def covered_cells(outline: Array, camera: Camera) -> Array:
    """CELLS: the part of each cell of the picture that is within an (N, 2) px polygon, 0 to 1."""
    rows, columns = (FINE * cells for cells in CELLS)
    fine = (outline + 0.5) / [camera.width, camera.height] * [columns, rows] - 0.5
    mask = cv2.fillPoly(np.zeros((rows, columns), np.uint8), [np.rint(fine).astype(np.int32)], 1)
    return np.asarray(mask.reshape(CELLS[0], FINE, CELLS[1], FINE).mean((1, 3)), np.float64)


def root_mean(variance: Array, axis: int | tuple[int, ...]) -> Array:
    """Without the pixels that see nothing; NaN where there is no other."""
    there = np.isfinite(variance)
    count = there.sum(axis)
    return np.sqrt(
        np.where(count > 0, np.where(there, variance, 0).sum(axis) / np.maximum(count, 1), np.nan)
    )


def _px(value: float) -> str:
    return f"{value:.2f}" if value < 10 else f"{value:.0f}"
