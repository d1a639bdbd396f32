"""The coverage of the views so far, and where to hold the board next. Pure: arrays in, a hint out.

There are two guides. The plain guide looks at the picture alone; it serves where torch is absent or
still loading. The informed guide knows how much each pose would tell about this camera and its
cover (calib.planning.design, computed in a separate process).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.planning.design import MAX_PLANNED_VIEWS, Design
from calib.planning.hints import placement_hint, tilt_of
from calib.planning.pose_bank import Reach, fit_bare_pose, make_pose_bank, outline
from calib.session.board import Board
from calib.session.camera import Camera
from capture.gate import check_novelty
from capture.live_detection import LiveDetection

Array = NDArray[np.float64]

TARGET_SIGMA_PX = 0.1  # px, a predicted sigma of the undistorted position that is good enough
COVERAGE_CELLS = (9, 12)  # rows and columns of the coverage maps
SAMPLES_PER_CELL = 16  # samples across a cell, to measure the fraction of it that a board covers


class RequiredViews(NamedTuple):
    """The numbers of views that the plain guide wants, as far as the board can give them."""

    per_cell: float
    per_depth: float
    per_tilt: float
    """For each side that is tilted away."""
    per_border: float
    """For each border that the board reaches over."""


REQUIRED_VIEWS = RequiredViews(per_cell=1.0, per_depth=4.0, per_tilt=2.0, per_border=2.0)
MIN_GAIN = 0.1  # the gain of a further view below which the plain rule is content
# fraction of the picture's width: the distance that counts for a corner that one view shows and the
# other does not
MISSING_CORNER_DISTANCE = 0.25
# a board over a quarter of the picture counts as much to the plain rule as a new depth or a new
# tilt
CELL_WEIGHT = 4.0


@dataclass(frozen=True, slots=True, eq=False)
class KeptView:
    """A view of the session."""

    corners: Array
    """(count, 2) px, NaN where not visible."""
    pose: Array | None = None
    """(6,) T_camera_board, rotation vector (rad) and translation (m). None: the pose that the bare
    camera would see.
    """


@dataclass(frozen=True, slots=True, eq=False)
class Hint:
    """The place where the person should hold the board next."""

    outline: Array
    """(N, 2) px, the polygon through the board's outermost corners. A board with markers may reach
    out of the picture.
    """
    pose: Array
    """(6,) rotation vector (rad) and translation (m)."""
    instruction: str
    """An instruction, such as: closer, to the left edge, tilt the right side away."""


@dataclass(frozen=True, slots=True, eq=False)
class SessionProgress:
    """The progress of the session."""

    is_enough: bool
    sentence: str
    sigma_px: float | None
    """The predicted standard deviation of the undistorted position, over the picture and the
    session's depths. None: not known.
    """
    views_needed: int | None
    """The likely number of further views; 0 if none are needed; None: not known."""
    image: Array
    """(h, w) coverage of the picture, 0 to 1."""
    depth: Array
    """(n,) coverage of the depths, near to far, 0 to 1."""
    glass: Array
    """(h, w) coverage of the patch of glass that the picture looks through, 0 to 1. Rows run along
    the cover, columns around it.
    """


class Guide(Protocol):
    """A guide says where to hold the board, and when the views are enough."""

    def next_pose(self, views: Sequence[KeptView]) -> Hint | None:
        """Return the pose to take next; None if no pose would help."""
        ...

    def progress(self, views: Sequence[KeptView]) -> SessionProgress: ...


class PlainGuide:
    """A guide by a plain rule: boards over the full picture, at every depth, tilted each way. It
    knows nothing about the cover.
    """

    def __init__(self, board: Board, camera: Camera, reach: Reach | None = None) -> None:
        """
        Args:
            camera: if it has no intrinsics, the guide assumes a usual lens.
            reach: None: the distances that the board's size allows.
        """
        self._board, self._camera = board, camera
        self._reach = reach or Reach.of(board, camera)
        self._bank = make_pose_bank(board, camera, self._reach)
        self._covered = np.array(
            [
                self._coverage_of(KeptView(*view))
                for view in zip(self._bank.corners, self._bank.poses, strict=True)
            ]
        )
        cells, levels = COVERAGE_CELLS[0] * COVERAGE_CELLS[1], len(self._reach.levels())
        self._required = np.repeat(REQUIRED_VIEWS, (cells, levels, 4, 4)) * self._covered.any(
            0
        )  # no checkerboard fills the outermost cells
        self._weights = np.repeat((CELL_WEIGHT / cells, 1.0, 1.0, 1.0), (cells, levels, 4, 4))

    def next_pose(self, views: Sequence[KeptView]) -> Hint | None:
        best = self._best_pose(self._sum_coverage(views))
        if best is None:
            return None
        return make_hint(
            self._bank.poses[best],
            self._bank.corners[best],
            views,
            self._board,
            self._camera,
            self._reach,
        )

    def progress(self, views: Sequence[KeptView]) -> SessionProgress:
        coverage = self._sum_coverage(views)
        cells, levels = COVERAGE_CELLS[0] * COVERAGE_CELLS[1], len(self._reach.levels())
        fraction = np.where(
            self._required > 0, np.minimum(coverage / np.maximum(self._required, 1e-9), 1), 0.0
        )
        image, depth = fraction[:cells].reshape(COVERAGE_CELLS), fraction[cells : cells + levels]
        needed = 0
        while (best := self._best_pose(coverage)) is not None:
            coverage = coverage + self._covered[best]
            needed += 1
        estimate = f"likely {needed} more view{'s' * (needed > 1)}" if needed else "enough"
        sentence = f"Judged by picture, depth and tilt: {estimate}."
        return SessionProgress(
            is_enough=not needed,
            sentence=sentence,
            sigma_px=None,
            views_needed=needed,
            image=image,
            depth=depth,
            glass=image,  # each pixel looks through its own point of the glass
        )

    def _best_pose(self, coverage: Array) -> int | None:
        """Return the pose that adds most of the missing coverage; None if nothing is missing."""
        gains = np.minimum(self._covered, np.maximum(self._required - coverage, 0)) @ self._weights
        return int(gains.argmax()) if gains.max() > MIN_GAIN else None

    def _sum_coverage(self, views: Sequence[KeptView]) -> Array:
        return (
            np.sum([self._coverage_of(view) for view in views], axis=0)
            if views
            else np.zeros(len(self._required))
        )

    def _coverage_of(self, view: KeptView) -> Array:
        """Return the fraction of each cell that the view covers, then flags for the view's depth,
        for each side that is tilted away and for each border that the board reaches over: left,
        right, top, bottom.
        """
        levels = self._reach.levels()
        pose = pose_of(view, self._board, self._camera)
        depth, sides = np.zeros(len(levels)), np.zeros(4)
        if pose is not None:
            horizontal, vertical = tilt_of(pose)
            depth[np.abs(1 / levels - 1 / pose[5]).argmin()] = 1
            sides[:] = horizontal < 0, horizontal > 0, vertical < 0, vertical > 0
        polygon = outline(view.corners, self._board)
        over = np.zeros(4)
        over[::2] = polygon.min(0) < 0
        over[1::2] = polygon.max(0) > (self._camera.width - 1, self._camera.height - 1)
        return np.concatenate(
            [
                covered_cells(visible_outline(view.corners, self._board), self._camera).ravel(),
                depth,
                sides,
                over,
            ]
        )


class InformedGuide:
    """A guide that proposes the view that lowers the maps' uncertainty most. The views are enough
    when the maps are accurate enough and the folds over the views agree.
    """

    def __init__(
        self,
        board: Board,
        camera: Camera,
        reach: Reach,
        design: Design,
        *,
        folds_agree: bool | None = None,
        target_px: float = TARGET_SIGMA_PX,
    ) -> None:
        """
        Args:
            design: computed at the estimate from the first `design.views` views; views after these
                count as the nearest pose of the bank.
            folds_agree: True if views that a fit has not used agree with it; None: not tried yet.
            target_px: the wanted sigma of the maps.
        """
        self._board, self._camera, self._reach = board, camera, reach
        self._design, self._folds_agree, self._target = design, folds_agree, target_px

    def next_pose(self, views: Sequence[KeptView]) -> Hint | None:
        best = self._design.plan(self._information(views), self._refused_poses(views), 0.0, limit=1)
        if not best:
            return None
        return make_hint(
            self._design.poses[best[0]],
            self._design.corners[best[0]],
            views,
            self._board,
            self._camera,
            self._reach,
        )

    def progress(self, views: Sequence[KeptView]) -> SessionProgress:
        information = self._information(views)
        variance = self._design.variance(information)  # (h, w, D)
        sigma = float(np.sqrt(np.nanmean(variance)))
        plan = self._design.plan(information, self._refused_poses(views), self._target)
        planned = information + self._design.information[plan].sum(0)
        needed = len(plan) if self._design.sigma(planned) <= self._target else None
        return SessionProgress(
            is_enough=needed == 0 and bool(self._folds_agree),
            sentence=self._sentence(sigma, needed),
            sigma_px=sigma,
            views_needed=needed,
            image=np.nan_to_num(np.minimum(self._target / root_mean(variance, 2), 1)),
            depth=np.nan_to_num(np.minimum(self._target / root_mean(variance, (0, 1)), 1)),
            glass=self._glass_coverage(views),
        )

    def _sentence(self, sigma: float, needed: int | None) -> str:
        estimate = f"The maps are likely off by {_px(sigma)} px; the goal is {_px(self._target)} px"
        if needed is None:
            return (
                f"{estimate}, which {MAX_PLANNED_VIEWS} more views would not reach: take nearer and"
                " larger boards."
            )
        if needed:
            return f"{estimate}: about {needed} more view{'s' if needed > 1 else ''}."
        if self._folds_agree is None:
            return f"{estimate}. The test with views left out of the fit is still running."
        if not self._folds_agree:
            return (
                f"{estimate}, but views left out of the fit do not agree: take more, fit, then"
                " diagnose."
            )
        return f"Enough: {estimate.lower()}, and views left out of the fit agree."

    def _information(self, views: Sequence[KeptView]) -> Array:
        later = views[self._design.views :]
        return self._design.precision() + sum(
            (self._design.information[self._nearest_pose(view)] for view in later), np.zeros(())
        )

    def _nearest_pose(self, view: KeptView) -> int:
        corners = upright(view.corners, self._board)
        in_pose = np.isfinite(self._design.corners[..., 0])  # (P, count)
        in_view = np.isfinite(corners[:, 0])
        missing = (MISSING_CORNER_DISTANCE * self._camera.width) ** 2
        squared = ((self._design.corners - corners) ** 2).sum(2)  # (P, count) px^2
        squared = np.where(in_pose & in_view, squared, np.where(in_pose | in_view, missing, 0))
        return int((squared.sum(1) / (in_pose | in_view).sum(1)).argmin())

    def _refused_poses(self, views: Sequence[KeptView]) -> NDArray[np.bool_]:
        """Return (P,), true for the poses that the gate would refuse because the session has such a
        view.
        """
        refused = np.zeros(len(self._design.poses), bool)
        squares = self._square_sizes()
        for view in views:
            corners = upright(view.corners, self._board)
            # (P, count) px^2, NaN where one of the two does not show the corner
            squared = ((self._design.corners - corners) ** 2).sum(2)
            shared = np.isfinite(squared).sum(1)
            near = (shared > 0) & (np.nansum(squared, 1) < shared * squares**2)
            for pose in np.flatnonzero(near):
                detection = LiveDetection(
                    self._design.corners[pose],
                    self._camera.width,
                    self._camera.height,
                    0.0,
                    square=squares[pose],
                )
                refused[pose] |= check_novelty(detection, None, [corners]) is not None
        return refused

    def _square_sizes(self) -> Array:
        """Return (P,) px, the mean side of a square in each pose of the bank."""
        grid = self._design.corners.reshape(-1, self._board.rows, self._board.columns, 2)
        steps = [
            np.linalg.norm(np.diff(grid, axis=axis), axis=-1).reshape(len(grid), -1)
            for axis in (2, 1)
        ]
        return np.asarray(np.nanmean(np.concatenate(steps, 1), 1))

    def _glass_coverage(self, views: Sequence[KeptView]) -> Array:
        """Return COVERAGE_CELLS: for each cell of the patch of glass, the fraction of
        REQUIRED_VIEWS whose boards crossed it.
        """
        crossed = np.sum(
            [
                covered_cells(visible_outline(view.corners, self._board), self._camera)
                for view in views
            ],
            axis=0,
        )
        glass = np.zeros(COVERAGE_CELLS)
        mask = np.isfinite(self._design.glass[..., 0])
        cells = np.array(COVERAGE_CELLS)
        places = np.clip(self._design.glass[mask] * cells, 0, cells - 1).astype(int)
        fraction = np.broadcast_to(crossed, COVERAGE_CELLS)[mask] / REQUIRED_VIEWS.per_cell
        np.maximum.at(glass, (places[:, 0], places[:, 1]), np.minimum(fraction, 1))
        return glass


def pose_of(view: KeptView, board: Board, camera: Camera) -> Array | None:
    """Return the (6,) pose of the view, or the pose that the bare camera would find; None where no
    pose gives these corners.
    """
    return fit_bare_pose(board, camera, view.corners) if view.pose is None else view.pose


def upright(corners: Array, board: Board) -> Array:
    """Return (count, 2) px, the same board with its corners in the order in which its columns run
    to the right, as in the bank.
    """
    grid = corners.reshape(board.rows, board.columns, 2)
    turns = [
        np.rot90(grid, quarter) for quarter in (range(4) if board.rows == board.columns else (0, 2))
    ]
    return max(turns, key=lambda turned: float(np.nansum(np.diff(turned[..., 0], axis=1)))).reshape(
        -1, 2
    )


def make_hint(
    pose: Array,
    corners: Array,
    views: Sequence[KeptView],
    board: Board,
    camera: Camera,
    reach: Reach,
) -> Hint:
    """Return the hint, in words as seen from the last view, where the person still stands."""
    last_pose = pose_of(views[-1], board, camera) if views else None
    polygon = outline(corners, board)
    return Hint(
        polygon,
        pose,
        placement_hint(
            pose, polygon, (camera.width, camera.height), last_pose, (reach.near, reach.far)
        ),
    )


def visible_outline(corners: Array, board: Board) -> Array:
    """Return (N, 2) px, the outline of the visible corners among (count, 2) px."""
    visible = np.isfinite(corners[:, 0])
    if visible.all():
        return outline(corners, board)
    return np.asarray(
        cv2.convexHull(corners[visible].astype(np.float32)).reshape(-1, 2), np.float64
    )


def covered_cells(outline: Array, camera: Camera) -> Array:
    """Return COVERAGE_CELLS: the fraction of each cell of the picture inside an (N, 2) px polygon,
    0 to 1.
    """
    rows = SAMPLES_PER_CELL * COVERAGE_CELLS[0]
    columns = SAMPLES_PER_CELL * COVERAGE_CELLS[1]
    fine = (outline + 0.5) / [camera.width, camera.height] * [columns, rows] - 0.5
    mask = cv2.fillPoly(np.zeros((rows, columns), np.uint8), [np.rint(fine).astype(np.int32)], 1)
    return np.asarray(
        mask.reshape(COVERAGE_CELLS[0], SAMPLES_PER_CELL, COVERAGE_CELLS[1], SAMPLES_PER_CELL).mean(
            (1, 3)
        ),
        np.float64,
    )


def root_mean(variance: Array, axis: int | tuple[int, ...]) -> Array:
    """Return the root mean variance over the pixels that see something; NaN where none does."""
    valid = np.isfinite(variance)
    count = valid.sum(axis)
    return np.sqrt(
        np.where(count > 0, np.where(valid, variance, 0).sum(axis) / np.maximum(count, 1), np.nan)
    )


def _px(value: float) -> str:
    return f"{value:.2f}" if value < 10 else f"{value:.0f}"
