"""The board is the last stage of the ray path: it gives the point in nominal board coordinates
where a ray lands, and the place of a corner in space.

Bends move the board's surface along its normal. Prints move its corners in its plane. A rolling
shutter moves the board line by line.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from calib.optics import rotation
from calib.optics.exposure import Exposure
from calib.optics.linear_term import LinearTerm
from calib.optics.params import Param, Values
from calib.optics.rays import MISSED_TARGET, Rays
from calib.optics.rotation import Rotation
from calib.optics.vector import Vector

MAX_ITERATIONS = 3
"""The limit on Newton steps onto a board that is not flat, before the differentiable step. Bends of
millimetres over a board need two.
"""
STEP_TOLERANCE = 1e-6
"""m. After a step this short, one more step is exact: its error is half the board's curvature times
the square of the step.
"""


POSE, MOTION, FLEX, FOCAL, CENTRE = "pose", "motion", "flex", "focal", "centre"
VIEW_BLOCKS = {POSE: 6, MOTION: 6, FLEX: 3, FOCAL: 1, CENTRE: 2}
"""The blocks of per-view parameters in their order, and the number of parameters in each.

Every view has a pose; the other blocks are optional, and a view has FOCAL or CENTRE, not both.
"""


def block_columns(blocks: Iterable[str]) -> dict[str, slice]:
    """Return the columns of each of these blocks among the parameters of one view."""
    columns, end = {}, 0
    for block in (block for block in VIEW_BLOCKS if block in blocks):
        columns[block] = slice(end, end + VIEW_BLOCKS[block])
        end += VIEW_BLOCKS[block]
    return columns


def blocks_of_size(count: int) -> tuple[str, ...]:
    """Return the blocks of a view that has this many parameters: 6, 9, 12 or 15, and up to two
    more.
    """
    of_board = count - count % 3
    return (
        POSE,
        *([MOTION] if of_board >= 12 else []),
        *([FLEX] if of_board % 6 else []),
        *([(FOCAL, CENTRE)[count % 3 - 1]] if count % 3 else []),
    )


def with_blocks(parameters: Tensor, blocks: Iterable[str]) -> Tensor:
    """Return the (V, B) parameters of views with exactly these blocks: a new block is zero, and a
    block that is not named is dropped.
    """
    columns = block_columns(blocks_of_size(parameters.shape[1]))
    zero = parameters.new_zeros(len(parameters), 1)
    return torch.cat(
        [
            parameters[:, columns[block]]
            if block in columns
            else zero.expand(-1, VIEW_BLOCKS[block])
            for block in block_columns(blocks)
        ],
        1,
    )


@dataclass(frozen=True, slots=True)
class Placement:
    """The poses of boards: T_camera_board as a rotation and a translation."""

    turn: Tensor
    """(..., 3, 3)"""
    shift: Tensor
    """(..., 3) m"""
    motion: Tensor | None = None
    """(..., 6): the rotation (rotation vector in the camera frame, rad) and translation (m) of the
    board during the readout of its picture.
    """

    flex: Tensor | None = None
    """(..., 3) m: the bend of the board in this view alone, in the terms of `FlexBend`."""

    @staticmethod
    def of(parameters: Tensor) -> Placement:
        """Return the placements of (..., B) view parameters: rotation vector (rad), translation
        (m), then the optional blocks in the order of VIEW_BLOCKS.
        """
        columns = block_columns(blocks_of_size(parameters.shape[-1]))
        motion = parameters[..., columns[MOTION]] if MOTION in columns else None
        flex = parameters[..., columns[FLEX]] if FLEX in columns else None
        return Placement(rotation.matrix(parameters[..., :3]), parameters[..., 3:6], motion, flex)

    def __getitem__(self, rows: Tensor) -> Placement:
        motion = None if self.motion is None else self.motion[rows]
        flex = None if self.flex is None else self.flex[rows]
        return Placement(self.turn[rows], self.shift[rows], motion, flex)

    def at_exposure(self, exposure: Exposure | None) -> Placement:
        """Return the placements at the time when the line of each ray is read."""
        if self.motion is None or exposure is None:
            return self
        motion = self.motion * exposure.line.unsqueeze(-1)
        return Placement(
            rotation.matrix(motion[..., :3]) @ self.turn,
            self.shift + motion[..., 3:],
            flex=self.flex,
        )


class Bend(Protocol):
    """A deviation of the board's surface from a plane."""

    @property
    def params(self) -> tuple[Param, ...]: ...

    def height(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """Return the (...) m height at (...) m board coordinates, positive away from the camera,
        and its slopes by x and by y. Nobody differentiates the slopes.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class FlexBend:
    """A bend that each view's board has for itself: xx (1 - u^2) + xy u v + yy (1 - v^2)."""

    half: tuple[float, float]
    """m: half the board's width and height; u = x / half[0], v = y / half[1]."""
    sizes: Tensor
    """(..., 3) m: xx, xy, yy of each ray's board."""

    @property
    def params(self) -> tuple[Param, ...]:
        return ()

    def height(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor, Tensor]:
        del values
        (a, b), (xx, xy, yy) = self.half, self.sizes.unbind(-1)
        u, v = x / a, y / b
        return (
            xx * (1 - u * u) + xy * u * v + yy * (1 - v * v),
            (xy * v - 2 * xx * u) / a,
            (xy * u - 2 * yy * v) / b,
        )

    def weights(self, x: Tensor, y: Tensor) -> Tensor:
        """Return the (..., 3) derivatives of the height by the three sizes."""
        u, v = x / self.half[0], y / self.half[1]
        return torch.stack([1 - u * u, u * v, 1 - v * v], -1)


class Print(Protocol):
    """A shift of the printed corners within the board's plane."""

    @property
    def params(self) -> tuple[Param, ...]: ...

    def shift_corners(self, x: Tensor, y: Tensor, values: Values) -> PrintShift:
        """Return the shifts of the corners at (...) m nominal board coordinates."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class PrintShift:
    """Shifts of corners within the board's plane."""

    shift_x: Tensor
    """(...) m, along x."""
    shift_y: Tensor
    """(...) m, along y."""
    slopes: tuple[tuple[Tensor | float, Tensor | float], tuple[Tensor | float, Tensor | float]]
    """The (...) derivatives of `shift_x` by x and y, then of `shift_y` by x and y. Nobody
    differentiates them.
    """


@dataclass(frozen=True, slots=True)
class Target:
    """A board, flat and printed as described unless something is added."""

    bends: tuple[Bend, ...] = ()
    prints: tuple[Print, ...] = ()
    flex: tuple[float, float] | None = None
    """m: half the board's size, if the board bends differently in every view."""

    @property
    def params(self) -> tuple[Param, ...]:
        return (
            *(param for bend in self.bends for param in bend.params),
            *(param for print_ in self.prints for param in print_.params),
        )

    def __call__(self, rays: Rays, placement: Placement, values: Values) -> tuple[Tensor, Tensor]:
        """Intersect rays with the board.

        Args:
            rays: (...) bundle in the camera frame.
            placement: (...), that of each ray's board.
            values: the parameters of bends and prints.

        Returns:
            (..., 2) m nominal board coordinates, and (...) uint8 failures.
        """
        landed, _, failure = self._intersect(rays, placement, values)
        return torch.stack(self._nominal(landed.x, landed.y, values), -1), failure

    def intersect_with_derivatives(
        self, rays: Rays, placement: Placement, values: Values
    ) -> tuple[Tensor, Tensor, list[Tensor]]:
        """Intersect rays with the board, and differentiate the landing points by the board's
        parameters in closed form (implicit function theorem).

        Returns:
            (..., 2) m landing points and (...) failures, as `__call__` returns them; and the
            derivatives of the landing points: (..., 2, 3, 3) by the entries of the board's
            rotation, (..., 2, 3) by its translation, and, if the board bends differently in every
            view, (..., 2, 3) by its flex. These neglect the slopes of the prints, which are
            thousandths.
        """
        landed, direction, failure = self._intersect(rays, placement, values)
        by_x, by_y = torch.zeros_like(landed.x), torch.zeros_like(landed.x)
        for bend in self._bends(placement):
            _, slope_x, slope_y = bend.height(landed.x, landed.y, values)
            by_x, by_y = by_x + slope_x, by_y + slope_y
        # Per metre that the surface moves along its z axis, (..., 2).
        by_height = torch.stack([direction.x, direction.y], -1) / (
            direction.z - by_x * direction.x - by_y * direction.y
        ).unsqueeze(-1)
        normal = torch.stack([-by_x, -by_y, torch.ones_like(by_x)], -1)
        # Per metre that the ray's points move in the board frame, (..., 2, 3).
        by_point = torch.eye(3).to(normal)[:2] - by_height.unsqueeze(-1) * normal.unsqueeze(-2)
        reach = (placement.turn @ landed.stacked().unsqueeze(-1)).squeeze(-1)
        derivatives = [
            by_point.unsqueeze(-2) * reach[..., None, :, None],
            -by_point @ placement.turn.mT,
        ]
        if self.flex and placement.flex is not None:
            derivatives.append(
                by_height.unsqueeze(-1)
                * FlexBend(self.flex, placement.flex).weights(landed.x, landed.y).unsqueeze(-2)
            )
        return torch.stack(self._nominal(landed.x, landed.y, values), -1), failure, derivatives

    def _intersect(
        self, rays: Rays, placement: Placement, values: Values
    ) -> tuple[Vector, Vector, Tensor]:
        """Return the (...) m points in the board frame where rays meet the board, the rays'
        directions in that frame, and the failures.
        """
        bends = self._bends(placement)
        turn = Rotation.of(placement.turn)
        origin = turn.turn(rays.origin - Vector.of(placement.shift), back=True)
        direction = turn.turn(rays.direction, back=True)
        grazing = direction.z.abs() < 1e-6
        distance = -origin.z / torch.where(grazing, torch.ones_like(direction.z), direction.z)
        with torch.no_grad():
            for _ in range(MAX_ITERATIONS if bends else 0):
                previous = distance
                distance = _newton_step(bends, origin, direction, distance, values)
                if bool(((distance - previous).abs() < STEP_TOLERANCE).all()):
                    break
        if bends:
            distance = _newton_step(bends, origin, direction, distance, values)
        landed = origin + direction * distance
        return (
            landed,
            direction,
            rays.advance(landed, direction, (grazing | (distance <= 0), MISSED_TARGET)).failure,
        )

    def place(self, corners: Tensor, placement: Placement, values: Values) -> Tensor:
        """Return the (..., 3) m points in the camera frame of corners at (..., 2) m nominal board
        coordinates on (...) boards.
        """
        x, y = corners.unbind(-1)
        for print_ in self.prints:
            shift = print_.shift_corners(corners[..., 0], corners[..., 1], values)
            x, y = x + shift.shift_x, y + shift.shift_y
        z = sum(
            (bend.height(x, y, values)[0] for bend in self._bends(placement)), torch.zeros_like(x)
        )
        return Rotation.of(placement.turn).turn(Vector(x, y, z)).stacked() + placement.shift

    def linear_terms(
        self, landed: Tensor, values: Values
    ) -> Iterator[tuple[LinearTerm, Tensor, Tensor]]:
        """Yield the bends and prints that are linear in their parameters, each with the two (...)
        coordinates at which it acts, for rays that landed at (..., 2) m nominal board coordinates.
        """
        x, y = landed.unbind(-1)
        shifts = [print_.shift_corners(x, y, values) for print_ in self.prints]
        printed_x = x + sum(shift.shift_x for shift in shifts)
        printed_y = y + sum(shift.shift_y for shift in shifts)
        for bend in self.bends:
            if isinstance(bend, LinearTerm):
                yield bend, printed_x, printed_y
        for print_ in self.prints:
            if isinstance(print_, LinearTerm):
                yield print_, x, y

    def _bends(self, placement: Placement) -> tuple[Bend, ...]:
        return (
            self.bends
            if self.flex is None or placement.flex is None
            else (*self.bends, FlexBend(self.flex, placement.flex))
        )

    def _nominal(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """Turn printed into nominal (...) m board coordinates by two Newton steps; the second is
        differentiable. The remaining error is of the fourth power of the shift.
        """
        if not self.prints:
            return x, y
        with torch.no_grad():
            start = self._nominal_step(x, y, (x, y), values)
        return self._nominal_step(x, y, start, values)

    def _nominal_step(
        self, x: Tensor, y: Tensor, start: tuple[Tensor, Tensor], values: Values
    ) -> tuple[Tensor, Tensor]:
        """Take Newton's step from `start` towards the (...) m nominal coordinates of the corner
        that is printed at (x, y).
        """
        at_x = start[0].detach()
        at_y = start[1].detach()
        shifts = [print_.shift_corners(at_x, at_y, values) for print_ in self.prints]
        error_x = at_x + sum(shift.shift_x for shift in shifts) - x
        error_y = at_y + sum(shift.shift_y for shift in shifts) - y
        xx = sum(shift.slopes[0][0] for shift in shifts) + 1
        xy = sum(shift.slopes[0][1] for shift in shifts)
        yx = sum(shift.slopes[1][0] for shift in shifts)
        yy = sum(shift.slopes[1][1] for shift in shifts) + 1
        determinant = xx * yy - xy * yx
        return (
            at_x - (yy * error_x - xy * error_y) / determinant,
            at_y - (xx * error_y - yx * error_x) / determinant,
        )


def _newton_step(
    bends: Iterable[Bend], origin: Vector, direction: Vector, distance: Tensor, values: Values
) -> Tensor:
    """Return the (...) m distance along the rays after Newton's step onto the bent board."""
    point = origin + direction * distance
    gap, slope = point.z, direction.z
    for bend in bends:
        height, by_x, by_y = bend.height(point.x, point.y, values)
        gap, slope = gap - height, slope - by_x * direction.x - by_y * direction.y
    slope = slope.detach()
    return distance - gap / torch.where(slope.abs() < 1e-6, torch.ones_like(slope), slope)
