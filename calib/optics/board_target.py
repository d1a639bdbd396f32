"""The board as the last stage of the ray path: where a ray lands, in nominal board coordinates, and
where a corner is in space.

Bends move its surface along the normal; prints move its corners in its plane; a rolling shutter
moves it line by line.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from calib.optics import rotation
from calib.optics.linear_part import LinearPart
from calib.optics.params import Param, Values
from calib.optics.rays import MISSED_TARGET, Rays
from calib.optics.rotation import Rotation
from calib.optics.vector import Vector

STEPS = 3
"""Newton steps onto a board that is not flat, before the differentiable one, at most: bends of
millimetres over a board need two.
"""
CLOSE = 1e-6
"""m: after steps no longer, one more is exact, as it leaves half the board's curvature times their
square.
"""


POSE, MOTION, FLEX = "pose", "motion", "flex"
PARTS = {POSE: 6, MOTION: 6, FLEX: 3}
"""What a view may have for itself, in this order, and the number of its parameters.

Every view has a pose.
"""


def columns(parts: Iterable[str]) -> dict[str, slice]:
    """Where these parts stand among a view's own parameters."""
    found, end = {}, 0
    for part in (part for part in PARTS if part in parts):
        found[part] = slice(end, end + PARTS[part])
        end += PARTS[part]
    return found


def parts_of(count: int) -> tuple[str, ...]:
    """Those of a view with so many parameters of its own: 6, 9, 12 or 15."""
    return (POSE, *([MOTION] if count >= 12 else []), *([FLEX] if count % 6 else []))


def with_parts(parameters: Tensor, parts: Iterable[str]) -> Tensor:
    """(V, B) parameters of views with other parts: what is new is zero, and what is not among them
    is dropped.
    """
    there = columns(parts_of(parameters.shape[1]))
    zero = parameters.new_zeros(len(parameters), 1)
    return torch.cat(
        [
            parameters[:, there[part]] if part in there else zero.expand(-1, PARTS[part])
            for part in columns(parts)
        ],
        1,
    )


@dataclass(frozen=True, slots=True)
class Placement:
    """Where boards stand: T_camera_board as a rotation and a translation."""

    turn: Tensor
    """(..., 3, 3)"""
    shift: Tensor
    """(..., 3) m"""
    motion: Tensor | None = None
    """(..., 6): by how much a board turns (rotation vector in the camera frame, rad) and moves (m)
    during a picture's readout.
    """

    flex: Tensor | None = None
    """(..., 3) m: how a view's board bends otherwise than the others', as `Flexed` has it."""

    @staticmethod
    def of(parameters: Tensor) -> Placement:
        """From (..., B) own parameters of views: rotation vector (rad), translation (m), and behind
        them what else there is of PARTS.
        """
        there = columns(parts_of(parameters.shape[-1]))
        motion, flex = (
            parameters[..., there[part]] if part in there else None for part in (MOTION, FLEX)
        )
        return Placement(rotation.matrix(parameters[..., :3]), parameters[..., 3:6], motion, flex)

    def __getitem__(self, rows: Tensor) -> Placement:
        motion, flex = (None if part is None else part[rows] for part in (self.motion, self.flex))
        return Placement(self.turn[rows], self.shift[rows], motion, flex)

    def during(self, line: Tensor | None) -> Placement:
        """Where the boards are while a line (...) of the picture is read, from -0.5, the first, to
        0.5.
        """
        if self.motion is None or line is None:
            return self
        moved = self.motion * line.unsqueeze(-1)
        return Placement(
            rotation.matrix(moved[..., :3]) @ self.turn, self.shift + moved[..., 3:], flex=self.flex
        )


class Bend(Protocol):
    """What makes a printed board not flat."""

    @property
    def params(self) -> tuple[Param, ...]: ...

    def height(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor, Tensor]:
        """(...) m board coordinates to (...) m away from the camera, and its slopes by x and by y,
        of which no derivatives are asked.
        """
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Flexed:
    """A board that bends in one view as it does in no other: xx (1 - u^2) + xy u v + yy (1 -
    v^2).
    """

    half: tuple[float, float]
    """m, where u and v are 1."""
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
        """(..., 3) of the height by each size."""
        u, v = x / self.half[0], y / self.half[1]
        return torch.stack([1 - u * u, u * v, 1 - v * v], -1)


class Print(Protocol):
    """What puts printed corners elsewhere than the board's description says."""

    @property
    def params(self) -> tuple[Param, ...]: ...

    def printed(self, x: Tensor, y: Tensor, values: Values) -> Printed:
        """Where (...) m nominal board coordinates are."""
        ...


@dataclass(frozen=True, slots=True, eq=False)
class Printed:
    """By how much corners are moved."""

    across: Tensor
    """(...) m, along x."""
    down: Tensor
    slopes: tuple[tuple[Tensor | float, Tensor | float], tuple[Tensor | float, Tensor | float]]
    """Of `across` by x and by y, and of `down`; (...) each, of which no derivatives are asked."""


@dataclass(frozen=True, slots=True)
class Target:
    """A board, flat and printed as described unless something is added."""

    bends: tuple[Bend, ...] = ()
    prints: tuple[Print, ...] = ()
    flex: tuple[float, float] | None = None
    """m, half the board's size, where it bends otherwise in every view."""

    @property
    def params(self) -> tuple[Param, ...]:
        return (
            *(param for bend in self.bends for param in bend.params),
            *(param for part in self.prints for param in part.params),
        )

    def __call__(self, rays: Rays, placement: Placement, values: Values) -> tuple[Tensor, Tensor]:
        """Where rays meet the board.

        Args:
            rays: (...) bundle in the camera frame.
            placement: (...) of each ray's board.
            values: the parameters of bends and prints.

        Returns:
            (..., 2) m nominal board coordinates, and (...) uint8 failures.
        """
        landed, _, failure = self._met(rays, placement, values)
        return torch.stack(self._nominal(landed.x, landed.y, values), -1), failure

    def adapting(
        self, rays: Rays, placement: Placement, values: Values
    ) -> tuple[Tensor, Tensor, list[Tensor]]:
        """Where rays meet the board, and how that changes with where the board is: in closed form,
        as an implicit function's.

        Returns:
            (..., 2) m and (...) failures, as when called; (..., 2, 3, 3) by the entries of the
            board's rotation, (..., 2, 3) by its place, and, where it bends otherwise in each view,
            (..., 2, 3) by how. The prints' slopes, thousandths, are left out of these.
        """
        landed, direction, failure = self._met(rays, placement, values)
        by_x, by_y = torch.zeros_like(landed.x), torch.zeros_like(landed.x)
        for bend in self._bends(placement):
            _, more_x, more_y = bend.height(landed.x, landed.y, values)
            by_x, by_y = by_x + more_x, by_y + more_y
        across = torch.stack([direction.x, direction.y], -1) / (
            direction.z - by_x * direction.x - by_y * direction.y
        ).unsqueeze(-1)
        normal = torch.stack([-by_x, -by_y, torch.ones_like(by_x)], -1)
        along = torch.eye(3).to(normal)[:2] - across.unsqueeze(-1) * normal.unsqueeze(
            -2
        )  # the board, as rays glide over it
        reach = (placement.turn @ landed.stacked().unsqueeze(-1)).squeeze(-1)
        changes = [along.unsqueeze(-2) * reach[..., None, :, None], -along @ placement.turn.mT]
        if self.flex and placement.flex is not None:
            changes.append(
                across.unsqueeze(-1)
                * Flexed(self.flex, placement.flex).weights(landed.x, landed.y).unsqueeze(-2)
            )
        return torch.stack(self._nominal(landed.x, landed.y, values), -1), failure, changes

    def _met(
        self, rays: Rays, placement: Placement, values: Values
    ) -> tuple[Vector, Vector, Tensor]:
        """(...) m where rays meet the printed board, in its frame, their directions there, and the
        failures.
        """
        bends = self._bends(placement)
        turn = Rotation.of(placement.turn)
        origin = turn.turn(rays.origin - Vector.of(placement.shift), back=True)
        direction = turn.turn(rays.direction, back=True)
        grazing = direction.z.abs() < 1e-6
        distance = -origin.z / torch.where(grazing, torch.ones_like(direction.z), direction.z)
        with torch.no_grad():
            for _ in range(STEPS if bends else 0):
                before, distance = distance, _closer(bends, origin, direction, distance, values)
                if bool(((distance - before).abs() < CLOSE).all()):
                    break
        if bends:
            distance = _closer(bends, origin, direction, distance, values)
        landed = origin + direction * distance
        return (
            landed,
            direction,
            rays.moved(landed, direction, (grazing | (distance <= 0), MISSED_TARGET)).failure,
        )

    def place(self, corners: Tensor, placement: Placement, values: Values) -> Tensor:
        """(..., 2) m nominal board coordinates on (...) boards to (..., 3) m in the camera
        frame.
        """
        x, y = corners.unbind(-1)
        for part in self.prints:
            moved = part.printed(corners[..., 0], corners[..., 1], values)
            x, y = x + moved.across, y + moved.down
        z = sum(
            (bend.height(x, y, values)[0] for bend in self._bends(placement)), torch.zeros_like(x)
        )
        return Rotation.of(placement.turn).turn(Vector(x, y, z)).stacked() + placement.shift

    def linear_parts(
        self, landed: Tensor, values: Values
    ) -> Iterator[tuple[LinearPart, Tensor, Tensor]]:
        """Those of the board's parts that are linear in their parameters, and the (...) coordinates
        that they are asked at, of rays that landed at (..., 2) m nominal board coordinates.
        """
        x, y = landed.unbind(-1)
        moved = [part.printed(x, y, values) for part in self.prints]
        across, down = x + sum(each.across for each in moved), y + sum(each.down for each in moved)
        yield from ((bend, across, down) for bend in self.bends if isinstance(bend, LinearPart))
        yield from ((part, x, y) for part in self.prints if isinstance(part, LinearPart))

    def _bends(self, placement: Placement) -> tuple[Bend, ...]:
        return (
            self.bends
            if self.flex is None or placement.flex is None
            else (*self.bends, Flexed(self.flex, placement.flex))
        )

    def _nominal(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """Printed to nominal board coordinates: a step towards these, and a differentiable one from
        where it led. What is left then goes with the fourth power of the shift.
        """
        if not self.prints:
            return x, y
        with torch.no_grad():
            near = self._unprinted(x, y, (x, y), values)
        return self._unprinted(x, y, near, values)

    def _unprinted(
        self, x: Tensor, y: Tensor, near: tuple[Tensor, Tensor], values: Values
    ) -> tuple[Tensor, Tensor]:
        """Newton's step from near the (...) m nominal coordinates of what is printed at (x, y)."""
        at_x, at_y = (at.detach() for at in near)
        moved = [part.printed(at_x, at_y, values) for part in self.prints]
        off_x, off_y = (
            at_x + sum(each.across for each in moved) - x,
            at_y + sum(each.down for each in moved) - y,
        )
        (xx, xy), (yx, yy) = (
            [sum(each.slopes[axis][by] for each in moved) + (axis == by) for by in (0, 1)]
            for axis in (0, 1)
        )
        size = xx * yy - xy * yx
        return at_x - (yy * off_x - xy * off_y) / size, at_y - (xx * off_y - yx * off_x) / size


def _closer(
    bends: Iterable[Bend], origin: Vector, direction: Vector, distance: Tensor, values: Values
) -> Tensor:
    """Newton's step along the rays, onto the bent board."""
    point = origin + direction * distance
    above, slope = point.z, direction.z
    for bend in bends:
        height, by_x, by_y = bend.height(point.x, point.y, values)
        above, slope = above - height, slope - by_x * direction.x - by_y * direction.y
    slope = slope.detach()
    return distance - above / torch.where(slope.abs() < 1e-6, torch.ones_like(slope), slope)
