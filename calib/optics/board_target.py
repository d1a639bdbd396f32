"""The board is the last stage of the ray path: it gives the point in nominal board coordinates
where a ray lands, and the place of a corner in space.

A ray lands in three steps. It meets the board's surface, which bends move along its normal. Glass
before a screen's pixels shifts the point that it sees. The print says which nominal point is
printed there. `Target` takes these steps; `Landing` takes them back, for the derivatives.

A rolling shutter moves the board line by line (`Placement.at_exposure`).
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from calib.optics.board_terms import Bend, Print, PrintShift
from calib.optics.derivatives import ByName, ByRay, by_autograd
from calib.optics.flex_bend import FlexBend
from calib.optics.front_glass import FLATTEST, FrontGlass
from calib.optics.linear_term import LinearTerm
from calib.optics.params import Param, Values
from calib.optics.placement import ByPlacement, Placement
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


@dataclass(frozen=True, slots=True)
class Target:
    """A board, flat and printed as described unless something is added."""

    bends: tuple[Bend, ...] = ()
    prints: tuple[Print, ...] = ()
    flex: tuple[float, float] | None = None
    """m: half the board's size, if the board bends differently in every view."""
    glass: FrontGlass | None = None
    """The pane before a screen's pixels."""

    @property
    def params(self) -> tuple[Param, ...]:
        return (
            *(param for bend in self.bends for param in bend.params),
            *(param for print_ in self.prints for param in print_.params),
            *([self.glass.thickness] if self.glass else []),
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
        landed, direction, _, failure = self._intersect(rays, placement, values)
        printed = self._behind_glass(landed, direction, values)
        return torch.stack(self._nominal(*printed, values), -1), failure

    def land(
        self, rays: Rays, placement: Placement, values: Values
    ) -> tuple[Tensor, Tensor, Landing]:
        """Return what `__call__` does, and what the derivatives need."""
        point, direction, distance, failure = self._intersect(rays, placement, values)
        by_x, by_y = torch.zeros_like(point.x), torch.zeros_like(point.x)
        for bend in self._bends(placement):
            _, slope_x, slope_y = bend.height(point.x, point.y, values)
            by_x, by_y = by_x + slope_x, by_y + slope_y
        nominal = self._nominal(*self._behind_glass(point, direction, values), values)
        landing = Landing(
            self, placement, values, point, direction, distance, (by_x, by_y), nominal
        )
        return torch.stack(nominal, -1), failure, landing

    def _intersect(
        self, rays: Rays, placement: Placement, values: Values
    ) -> tuple[Vector, Vector, Tensor, Tensor]:
        """Return the (...) m points in the board frame where rays meet the board, the rays'
        directions in that frame, the m from their origins, and the failures.
        """
        bends = self._bends(placement)
        turn = Rotation.of(placement.turn)
        origin = turn.turn(rays.origin - Vector.of(placement.shift), back=True)
        direction = turn.turn(rays.direction, back=True)
        grazing = direction.z.abs() < FLATTEST
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
            distance,
            rays.advance(landed, direction, (grazing | (distance <= 0), MISSED_TARGET)).failure,
        )

    def place(
        self, corners: Tensor, placement: Placement, values: Values, rays: Rays | None = None
    ) -> Tensor:
        """Return the (..., 3) m points in the camera frame of corners at (..., 2) m nominal board
        coordinates on (...) boards, or of (..., 3) m points of targets that are not flat. With
        (...) rays, return where glass before the board lets the corners appear to them.
        """
        x, y, *heights = corners.unbind(-1)
        for print_ in self.prints:
            shift = print_.shift_corners(corners[..., 0], corners[..., 1], values)
            x, y = x + shift.shift_x, y + shift.shift_y
        z = sum(
            (bend.height(x, y, values)[0] for bend in self._bends(placement)),
            heights[0] if heights else torch.zeros_like(x),
        )
        turn = Rotation.of(placement.turn)
        if self.glass and rays:
            direction = turn.turn(rays.direction, back=True)
            shift_x, shift_y = self.glass.shift(direction, values)
            x, y = x - shift_x, y - shift_y
        return turn.turn(Vector(x, y, z)).stacked() + placement.shift

    def _behind_glass(
        self, point: Vector, direction: Vector, values: Values
    ) -> tuple[Tensor, Tensor]:
        """Return the (...) m printed board coordinates that rays see which, without the glass,
        would meet the board at `point`.
        """
        if not self.glass:
            return point.x, point.y
        x, y = self.glass.shift(direction, values)
        return point.x + x, point.y + y

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
        xx, xy, yx, yy = _printed_slopes(shifts)
        determinant = xx * yy - xy * yx
        return (
            at_x - (yy * error_x - xy * error_y) / determinant,
            at_y - (xx * error_y - yx * error_x) / determinant,
        )


@dataclass(frozen=True, slots=True)
class Landing:
    """M rays where they meet the board, in the board's frame."""

    target: Target
    placement: Placement
    values: Values
    point: Vector
    direction: Vector
    distance: Tensor
    """(M,) m from the rays' origins."""
    slopes: tuple[Tensor, Tensor]
    """The (M,) slopes of the board's surface by x and by y."""
    nominal: tuple[Tensor, Tensor]
    """The (M,) m nominal board coordinates of the point, or of what is seen there through glass."""

    def linear_terms(self) -> Iterator[tuple[LinearTerm, Tensor, Tensor]]:
        """Yield the bends and prints that are linear in their parameters, each with the two (M,) m
        coordinates at which it acts.
        """
        for bend in self.target.bends:
            if isinstance(bend, LinearTerm):
                yield bend, self.point.x, self.point.y
        for print_ in self.target.prints:
            if isinstance(print_, LinearTerm):
                yield print_, *self.nominal

    def pull(
        self, by_landed: Tensor, names: frozenset[str] = frozenset()
    ) -> tuple[ByRay, ByPlacement, ByName]:
        """Return the derivatives by the rays, by the placement and by the parameters of these
        names, from the (k, M, 2) derivatives by the nominal coordinates: by the implicit function
        theorem. Those by linear bends and prints are given by their probes.
        """
        (by_x, by_y), by = self._pull_print(by_landed, names)
        by_height = self._by_height(by_x, by_y)
        by |= self._by_bends(by_height, names)
        slope_x, slope_y = self.slopes
        by_origin = Vector(by_x + slope_x * by_height, by_y + slope_y * by_height, -by_height)
        turn = Rotation.of(self.placement.turn)  # from the board's frame to the camera's
        by_place = turn.turn(by_origin)
        by_turn = by_place.cross(turn.turn(self.point))
        by_direction = by_place * self.distance
        if glass := self.target.glass:
            by_bent, by_glass = glass.pull(self.direction, self.values, (by_x, by_y))
            by |= {name: value for name, value in by_glass.items() if name in names}
            by_bent = turn.turn(by_bent)
            by_turn = by_turn + by_bent.cross(turn.turn(self.direction))
            by_direction = by_direction + by_bent
        by_shift = Vector(-by_place.x, -by_place.y, -by_place.z)
        by_placement = ByPlacement(by_turn, by_shift, self._by_flex(by_height))
        return ByRay(by_place, by_direction), by_placement, by

    def _by_height(self, by_x: Tensor, by_y: Tensor) -> Tensor:
        """Return the (k, M) derivatives by the height of the board's surface, from those by the
        point's place: a higher surface is met earlier on the ray.
        """
        slope_x, slope_y = self.slopes
        direction = self.direction
        change = direction.x * by_x + direction.y * by_y
        steepness = direction.z - slope_x * direction.x - slope_y * direction.y
        return change / torch.where(
            steepness.abs() < FLATTEST, torch.ones_like(steepness), steepness
        )

    def _by_flex(self, by_height: Tensor) -> Tensor | None:
        """Return the (k, M, FLEX_TERMS) derivatives by the bend of each view; None without."""
        if not self.target.flex or self.placement.flex is None:
            return None
        bend = FlexBend(self.target.flex, self.placement.flex)
        return by_height.unsqueeze(-1) * bend.weights(self.point.x, self.point.y)

    def _pull_print(
        self, by_landed: Tensor, names: frozenset[str]
    ) -> tuple[tuple[Tensor, Tensor], ByName]:
        """Return the derivatives by the printed coordinates of the point, and by the prints."""
        by_x, by_y = by_landed.unbind(-1)
        prints = self.target.prints
        if not prints:
            return (by_x, by_y), {}
        x, y = self.nominal
        shifts = [print_.shift_corners(x, y, self.values) for print_ in prints]
        xx, xy, yx, yy = _printed_slopes(shifts)
        determinant = xx * yy - xy * yx
        printed = (yy * by_x - yx * by_y) / determinant, (xx * by_y - xy * by_x) / determinant
        copies = self._copies(prints, names)
        if not copies:
            return printed, {}

        def shift_of(copy: Values) -> tuple[Tensor, Tensor]:
            moved = [print_.shift_corners(x, y, {**self.values, **copy}) for print_ in prints]
            return (
                torch.stack([shift.shift_x for shift in moved]).sum(0),
                torch.stack([shift.shift_y for shift in moved]).sum(0),
            )

        return printed, by_autograd(shift_of, copies)[1]([-printed[0], -printed[1]])

    def _by_bends(self, by_height: Tensor, names: frozenset[str]) -> ByName:
        """Return the derivatives by the bends, whose heights and probes add up."""
        linear = [bend for bend in self.target.bends if isinstance(bend, LinearTerm)]
        by = {probe: by_height for bend in linear for probe in bend.probes.values()}
        others = [bend for bend in self.target.bends if not isinstance(bend, LinearTerm)]
        copies = self._copies(others, names)
        if not copies:
            return by

        def height_of(copy: Values) -> tuple[Tensor]:
            values = {**self.values, **copy}
            heights = [bend.height(self.point.x, self.point.y, values)[0] for bend in others]
            return (torch.stack(heights).sum(0),)

        return by | by_autograd(height_of, copies)[1]([by_height])

    def _copies(self, terms: Iterable[Bend | Print], names: frozenset[str]) -> dict[str, Tensor]:
        """Return a copy for each ray of the parameters of these names that the terms read, and for
        those that act by a probe, the probe.
        """
        rows = len(self.point.x)
        copies: dict[str, Tensor] = {}
        for term in terms:
            probes = term.probes if isinstance(term, LinearTerm) else {}
            for name in (param.name for param in term.params if param.name in names):
                copies[probes.get(name, name)] = (
                    self.point.x.new_zeros(rows)
                    if name in probes
                    else self.values[name].expand(rows, *self.values[name].shape)
                )
        return copies


def _printed_slopes(
    shifts: Sequence[PrintShift],
) -> tuple[Tensor | float, Tensor | float, Tensor | float, Tensor | float]:
    """Return the derivatives of the printed x by the nominal x and y, then of the printed y."""
    return (
        sum(shift.slopes[0][0] for shift in shifts) + 1,
        sum(shift.slopes[0][1] for shift in shifts),
        sum(shift.slopes[1][0] for shift in shifts),
        sum(shift.slopes[1][1] for shift in shifts) + 1,
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
    return distance - gap / torch.where(slope.abs() < FLATTEST, torch.ones_like(slope), slope)
