"""What each placement of a rig's fit tells of the rig's numbers, and of motions of each camera and
of the board that each camera sees: the inner products of its linearised residuals.

Effects of the rig are combinations of these motions. A camera that is late sees the board further
on its path; a mounting that differs, or slipped, is a motion of the camera.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.errors import InputError
from calib.estimation.objective import HUBER
from calib.rig.board_motion import motion_in_placement
from calib.rig.gauge import mounting_motion
from calib.rig.joint_estimate import CameraState, RigState
from calib.rig.own_effects import OwnEffect, WideState
from calib.rig.pose_terms import PoseTerms
from calib.rig.problem import CameraProblem, RigProblem

MAX_BYTES = 4e9
"""The most memory that the products may take."""
POSE = slice(0, 6)
"""The columns of the pose of the placement itself."""
MOTIONS = 12
"""A motion of the camera, then one of the board that it sees: a rotation (rad) and a translation
(m) each. That of the camera is a motion of everything outside, in the camera's frame.
"""
READOUT = 6
"""A motion of the board during the readout of a camera's picture, from its first line to its last:
a rotation (rad) and a translation (m), as those of the board that the camera sees.
"""
PLACEMENTS_AT_ONCE = 8
"""The number of placements whose rows are in memory together."""
SMOOTH = 2.0
"""The correlation length of errors that are nearly the same all over a board, in its longer
sides.
"""
NORMAL_MEDIAN = 1.1774
"""The median length of a normal vector in two dimensions."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class MotionProducts:
    """The inner products of each placement's columns, in standard deviations of the corners: those
    of the placement (E: its pose, and its bend if the fit has one), of the rig's numbers (S), of
    the motions of each camera (12 each), of the motions of the board during its readout (6 each),
    of a bend of the board that the fit lacks, those of effects of single cameras and of the board,
    and the residual.
    """

    products: Array
    """(P, n, n), with the prior of the placements."""
    halves: Array
    """(2, P, n, n) the same of every other corner, without the prior."""
    blocks: Array
    """(P, E) the numbers of the placements."""
    block_precision: Array
    """(E,) that of their prior: 0 for a pose."""
    bends: slice
    """The columns of a bend of the board in each placement; empty if the fit has it, or if the
    board is stiff.
    """
    numbers: NDArray[np.int64]
    """(S,) the columns of the rig's vector."""
    own_effects: tuple[OwnEffect, ...]
    """Effects of single cameras and of the board, with their columns as entries."""
    motions: Mapping[str, slice]
    """The columns of the motions of each camera."""
    vector: Array
    """(S,) the rig's vector, by which the residual was linearised."""
    precision: Array
    """(S, S) that of its prior."""
    imitations: Mapping[str, Array]
    """For each camera, the (2, P, 6, 6) covariances of the motions of the board that errors of its
    corners of 1 px imitate: errors without a pattern in the six numbers, and errors that are nearly
    the same all over the board. 0 where it sees none.
    """
    corners: Mapping[str, NDArray[np.int64]]
    """For each camera, the (P,) corners that it sees."""
    readouts: Mapping[str, slice] = field(default_factory=dict)
    """The columns of the motions during the readout of each camera; 0 for corners without an
    exposure.
    """
    without_placements: Array = field(init=False, repr=False)
    """(P, n, n) the products with the placements integrated out: zeros in their columns."""
    total: Array = field(init=False, repr=False)
    """(n, n) the sum of these."""

    def __post_init__(self) -> None:
        rows = self.products[:, self.placement, :]
        inner = rows[:, :, self.placement]
        reduction = rows.swapaxes(1, 2) @ np.linalg.solve(inner, rows)
        object.__setattr__(self, "without_placements", self.products - reduction)
        object.__setattr__(self, "total", self.without_placements.sum(0))

    @property
    def placement(self) -> slice:
        """The columns of the placement itself, with the bend that the fit has."""
        return slice(0, len(self.block_precision))

    @staticmethod
    def of(wider: WideState) -> MotionProducts:
        """Linearise the placements of a rig at the state of its fit."""
        state = wider.state
        wide = _with_motions(state)
        vector = wide.vector()
        order = _ColumnOrder.of(wider, len(vector))
        _check_size(order.count, len(state.placements))
        halves, imitations = _summed(wide, order)
        halves = halves[:, :, order.columns[:, None], order.columns]
        problem = wide.problem()
        blocks = state.placements[:, : order.fitted].numpy()
        block_precision = problem.block_precision[: order.fitted].numpy()
        precision = problem.precision.numpy()
        if baseline := problem.baseline_row(vector):
            _, slope, entries = baseline
            places = entries.numpy()  # in the vector
            precision[np.ix_(places, places)] += torch.outer(slope, slope).numpy()
        base = wider.base
        return MotionProducts(
            products=_with_prior(halves.sum(0), blocks, block_precision),
            halves=halves,
            blocks=blocks,
            block_precision=block_precision,
            bends=order.bends,
            numbers=order.fitted + np.arange(len(base)),
            own_effects=tuple(
                replace(effect, entries=order.places[order.block + effect.entries])
                for effect in wider.effects
            ),
            motions={name: order.moved(place) for name, place in order.motions.items()},
            vector=vector.numpy()[base],
            precision=precision[np.ix_(base, base)],
            imitations=imitations,
            corners={camera.name: _corner_counts(camera, state) for camera in state.cameras},
            readouts={name: order.moved(place) for name, place in order.readouts.items()},
        )

    def without_own_effects(self) -> MotionProducts:
        """Return the products without the columns of effects of single cameras and of the board,
        which come last.
        """
        columns = np.r_[np.arange(self.bends.stop), self.products.shape[-1] - 1]
        return replace(
            self,
            products=self.products[:, columns[:, None], columns],
            halves=self.halves[:, :, columns[:, None], columns],
            own_effects=(),
        )


@dataclass(frozen=True, slots=True, eq=False)
class _ColumnOrder:
    """The columns of linearised rows, which have the whole placement first and then the vector, in
    the order of `MotionProducts`.
    """

    count: int
    """The number of columns."""
    block: int
    """B, the number of columns of the whole placement."""
    fitted: int
    """E, those of the numbers that the fit has."""
    motions: Mapping[str, slice]
    """The motions of each camera among the columns of the rows."""
    readouts: Mapping[str, slice]
    """Those of the board during its readout."""
    columns: NDArray[np.int64]
    """(n,) the columns of the rows in the order of the products."""

    @staticmethod
    def of(wider: WideState, length: int) -> _ColumnOrder:
        """Return the order for a vector of some length, with the motions at its end."""
        state, base = wider.state, wider.base
        block = state.placements.shape[1]
        fitted = POSE.stop if wider.board_flex else block
        first = block + len(state.vector())
        motions = {
            camera.name: slice(first + MOTIONS * index, first + MOTIONS * (index + 1))
            for index, camera in enumerate(state.cameras)
        }
        start = first + MOTIONS * len(motions)
        readouts = {
            camera.name: slice(start + READOUT * index, start + READOUT * (index + 1))
            for index, camera in enumerate(state.cameras)
        }
        moving = np.arange(first, block + length)
        named = np.r_[np.arange(fitted), block + base, moving, np.arange(fitted, block)]
        residual = block + length
        further = np.setdiff1d(np.arange(residual), named)
        return _ColumnOrder(
            count=residual + 1,
            block=block,
            fitted=fitted,
            motions=motions,
            readouts=readouts,
            columns=np.r_[named, further, residual].astype(np.int64),
        )

    @property
    def places(self) -> NDArray[np.int64]:
        """(n,) the place of each column of the rows in the products."""
        return np.argsort(self.columns)

    @property
    def bends(self) -> slice:
        """The place of the bends that the fit lacks: behind the last motion."""
        first = max(self.moved(place).stop for place in self.readouts.values())
        return slice(first, first + self.block - self.fitted)

    def moved(self, columns: slice) -> slice:
        """Return the place of consecutive columns of the rows in the products."""
        first = int(self.places[columns.start])
        return slice(first, first + columns.stop - columns.start)


def _summed(wide: RigState, order: _ColumnOrder) -> tuple[Array, dict[str, Array]]:
    """Return the (2, P, n, n) products of every other corner of each placement, and the imitations
    of `MotionProducts`.

    Args:
        wide: the state with the motions of each camera.
        order: the columns of the rows.
    """
    vector, count, columns = wide.vector(), len(wide.placements), order.count
    limit = _robust_limit(wide, vector)
    halves = np.zeros((2, count, columns, columns))
    imitations = {camera.name: np.zeros((2, count, 6, 6)) for camera in wide.cameras}
    for first in range(0, count, PLACEMENTS_AT_ONCE):
        chunk = wide.select_placements(range(first, first + PLACEMENTS_AT_ONCE))
        problem = with_limit(chunk.problem(), limit)
        for camera, numbers in zip(chunk.cameras, problem.cameras, strict=True):
            motions, readout = order.motions[camera.name], order.readouts[camera.name]
            moved = range(motions.stop - 6, motions.stop)
            lines = _lines(camera)
            for view, rows in enumerate(_rows(numbers, vector, chunk.placements)):
                place = first + int(camera.placement[view])
                is_in_view = camera.observations.view == view
                lines_of_view = lines[is_in_view].numpy()[:, None, None]
                rows[..., readout] = lines_of_view * rows[..., moved]
                for half in (0, 1):
                    chosen = rows[half::2].reshape(-1, columns)
                    halves[half, place] += chosen.T @ chosen
                points = camera.observations.corners[is_in_view]
                slopes = rows[..., moved].reshape(-1, 6) * camera.sigma
                imitations[camera.name][:, place] += _imitations(slopes, points.numpy())
    return halves, imitations


def _with_prior(products: Array, blocks: Array, precision: Array) -> Array:
    """Return the (P, n, n) products with the prior of the placements' (P, E) numbers, of (E,)
    precision about zero.
    """
    places = range(len(precision))
    pull = precision * blocks
    products[:, places, places] += precision
    products[:, places, -1] += pull
    products[:, -1, places] += pull
    products[:, -1, -1] += (pull * blocks).sum(1)
    return products


def _lines(camera: CameraState) -> Tensor:
    """Return the (M,) times of all corners within the readout of their picture, from -0.5 to 0.5; 0
    where it is not known.
    """
    exposure = camera.observations.exposure
    return exposure.line if exposure else torch.zeros(len(camera.observations.pixels))


def _corner_counts(camera: CameraState, state: RigState) -> NDArray[np.int64]:
    """Return the (P,) numbers of corners that a camera sees of each placement."""
    places = camera.placement[camera.observations.view].numpy()
    return np.bincount(places, minlength=len(state.placements)).astype(np.int64)


def _check_size(columns: int, placements: int) -> None:
    """Raise InputError if the products would not fit into memory."""
    size = 4 * 8 * placements * columns**2
    if size > MAX_BYTES:
        raise InputError(
            f"The diagnosis of {columns} numbers in {placements} placements needs"
            f" {size / 1e9:.0f} GB: fit a rig of fewer placements, and diagnose that."
        )


def with_limit(problem: RigProblem, limit: float) -> RigProblem:
    """Return a rig's problem with another limit of Huber's loss, and without the baseline."""
    cameras = tuple(
        replace(camera, landing=replace(camera.landing, huber=limit)) for camera in problem.cameras
    )
    return replace(problem, cameras=cameras, baseline=None)


def motion_terms(camera: CameraState, state: RigState, index: int, first: int) -> PoseTerms:
    """Return the 12 motions of a camera as terms of its poses.

    Args:
        index: of the camera.
        first: the place of the first motion among the numbers of the state.
    """
    count = len(camera.placement)
    by_mounting = torch.zeros(count, 6, MOTIONS, dtype=torch.float64)
    by_placement = torch.zeros(count, 6, MOTIONS, dtype=torch.float64)
    mounting = state.mountings[state.layout.frames[index]]
    by_mounting[:, :, :6] = torch.from_numpy(np.linalg.inv(mounting_motion(mounting)))
    placements = state.placements[camera.placement].numpy()
    by_placement[:, :, 6:] = torch.from_numpy(motion_in_placement(placements[:, POSE]))
    return PoseTerms(torch.arange(first, first + MOTIONS), by_mounting, by_placement)


def _with_motions(state: RigState) -> RigState:
    """Return the state with the motions of each camera, and those of the board during its readout,
    as further numbers, all zero. The latter have no terms: a pose is that of a whole picture.
    """
    cameras = []
    count = len(state.numbers)
    for index, camera in enumerate(state.cameras):
        terms = motion_terms(camera, state, index, count + MOTIONS * index)
        cameras.append(replace(camera, terms=terms.joined(camera.terms)))
    further = (MOTIONS + READOUT) * len(cameras)
    return replace(
        state,
        cameras=tuple(cameras),
        numbers=torch.cat([state.numbers, torch.zeros(further, dtype=torch.float64)]),
        spreads=torch.cat([state.spreads, torch.full((further,), torch.inf, dtype=torch.float64)]),
    )


def _robust_limit(state: RigState, vector: Tensor) -> float:
    """Return Huber's limit from the typical residual: a missing effect moves all corners, and must
    not be weighed down as an outlier.
    """
    problem = state.problem()
    lengths = []
    for camera in problem.cameras:
        poses = camera.compose(vector, state.placements)
        residual, lands = camera.landing.residual(vector[camera.columns], poses)
        lengths.append(residual[lands].norm(dim=-1))
    return HUBER * max(1.0, float(torch.cat(lengths).median()) / NORMAL_MEDIAN)


def _rows(camera: CameraProblem, vector: Tensor, placements: Tensor) -> Iterator[Array]:
    """Yield, for each view of a camera, the (m, 2, n) columns of its m corners: those of the
    whole placement, of the vector, and the residual.
    """
    if not len(camera.placement):
        return
    composed = camera.compose_with_derivatives(vector, placements)
    by_moving = camera.by_moving(composed).numpy()
    by_placement = composed.by_placement.numpy()
    block = placements.shape[1]
    columns, moving = block + camera.columns.numpy(), block + camera.moving.numpy()
    view = 0
    for piece in camera.landing.linearise(vector[camera.columns], composed.poses):
        for start, stop in pairwise(piece.starts.tolist()):
            by_pose = piece.jacobian_block[start:stop].numpy()  # (m, 2, B)
            rows = np.zeros((stop - start, 2, block + len(vector) + 1))
            rows[..., :block] = by_pose @ by_placement[view]
            rows[..., columns] = piece.jacobian_shared[start:stop].numpy()
            rows[..., moving] = by_pose @ by_moving[view]
            rows[..., -1] = piece.residual[start:stop].numpy()
            yield rows
            view += 1


def _imitations(slopes: Array, points: Array) -> Array:
    """Return the (2, 6, 6) covariances of `MotionProducts.imitations` of one view.

    Args:
        slopes: (2 m, 6) px by a motion of the board.
        points: (m, 2) m on the board.
    """
    if len(points) <= 6:
        return np.zeros((2, 6, 6))
    inverse = np.linalg.pinv(slopes)
    plain = inverse @ inverse.T * len(points) / 6
    side = np.ptp(points, axis=0).max()
    squares = ((points[:, None] - points) ** 2).sum(-1) / side**2
    kernel = np.kron(np.exp(-squares / (2 * SMOOTH**2)), np.eye(2)) / 2
    return np.stack([plain, inverse @ kernel @ inverse.T])
