"""The print is longer in one direction than in the other, its directions may not be at right
angles, and it may be drawn out unevenly. What both directions share is the board's size, which no
view can tell.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown, most_evident
from calib.effects.over_board import Term, called, monomials, powers, terms_of
from calib.optics.board_target import PrintShift
from calib.optics.linear_term import contract
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.tolerances import PRINT_SHEAR, PRINT_STRETCH, PRINT_UNEVEN

STRETCH = Unknown.of("board_scale.x_over_y", PRINT_STRETCH)
SHEAR = Unknown.of("board_scale.shear", PRINT_SHEAR)
DEGREES = (2, 3)
"""Of what is uneven: a stretch that grows along the sheet, and one that is largest at its middle or
at its edges.
"""


@dataclass(frozen=True, slots=True)
class BoardScale(Effect):
    """x is longer by half of the stretch, and y shorter by half of it; of a print that is sheared,
    each direction is turned towards the other by half of the angle; of one that is uneven, corners
    are moved by Legendre's P_i(u) P_j(v), i + j = 2, 3, along x and along y, each term called by i
    times x, j times y. What is left of degrees 0 and 1 is the pose's and the board's size.
    """

    sheared: bool = False
    degree: int = 1
    """Of what is uneven; 1: nothing is."""
    half: tuple[float, float] = (1.0, 1.0)
    """m, half the distance between the outermost corners along x and y: there u and v are 1."""
    name: ClassVar[str] = "board_scale"
    about: ClassVar[str] = "the board"
    advice: ClassVar[str] = "turn the board by 90 degrees in half of the views"

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        return (cls(True, DEGREES[-1], there.board.half),)

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        even = (STRETCH, SHEAR) if self.sheared else (STRETCH,)
        return (
            *even,
            *(
                _unknown(axis, term, max(self.half))
                for degree in self._degrees
                for axis in "xy"
                for term in terms_of((degree,))
            ),
        )

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.unknowns)

    @property
    def _degrees(self) -> tuple[int, ...]:
        return tuple(degree for degree in DEGREES if degree <= self.degree)

    def alternatives(self) -> tuple[Self, ...]:
        even = replace(self, sheared=False, degree=1), replace(self, sheared=True, degree=1)
        return (*even, *(replace(self, sheared=True, degree=degree) for degree in DEGREES))

    def tuned(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """With the largest evidence, to first order."""
        mine = self.sheared, self.degree
        return most_evident(
            [form for form in self.alternatives() if (form.sheared, form.degree) <= mine],
            information,
            score,
        )

    def apply(self, path: Path) -> Path:
        return replace(path, target=replace(path.target, prints=(*path.target.prints, self)))

    def shift_corners(self, x: Tensor, y: Tensor, values: Values) -> PrintShift:
        """Where nominal board coordinates are."""
        half = values[STRETCH.param.name] / 2
        turned = values[SHEAR.param.name] / 2 if self.sheared else half.new_zeros(())
        with torch.no_grad():
            along, aside = half.clone(), turned.clone()
        across, down = half * x + turned * y, turned * x - half * y
        if not self._degrees:
            return PrintShift(across, down, ((along, aside), (aside, -along)))
        more, fall = self._uneven(x, y, values)
        return PrintShift(
            across + more[0],
            down + fall[0],
            ((along + more[1], aside + more[2]), (aside + fall[1], fall[2] - along)),
        )

    def _uneven(self, x: Tensor, y: Tensor, values: Values) -> list[tuple[Tensor, Tensor, Tensor]]:
        """(...) m along each direction, with its slopes by x and by y."""
        with torch.no_grad():
            (u, inside_u), (v, inside_v) = self._powers(x, y)
            rises = torch.arange(1, self.degree + 1).to(u).reshape(-1, *[1] * x.ndim)
            rise_u, rise_v = (
                u[:-1] * rises * (inside_u / self.half[0]),
                v[:-1] * rises * (inside_v / self.half[1]),
            )
        moved = []
        for probe in _PROBES:
            sizes = torch.stack(
                [values[name] for name, by in self.probes.items() if by == probe], -1
            )
            table = (sizes @ _monomials(self._degrees).to(sizes)).reshape(
                *sizes.shape[:-1], self.degree + 1, self.degree + 1
            )
            along = contract(u, table)
            shift = (along * v).sum(0)
            with torch.no_grad():
                slopes = (
                    (contract(rise_u, table[..., 1:, :]) * v).sum(0),
                    (along[1:] * rise_v).sum(0),
                )
            moved.append((shift + values[probe] if probe in values else shift, *slopes))
        return moved

    @property
    def probes(self) -> dict[str, str]:
        """Of what is uneven; stretch and shear act along both directions."""
        return {
            param.name: _PROBES["xy".index(param.name.split(".")[1])]
            for param in self.params
            if param.name.count(".") == 2
        }

    def weights(self, x: Tensor, y: Tensor) -> dict[str, Tensor]:
        """As `linear_term` has them."""
        if not self._degrees:
            return {}
        (u, _), (v, _) = self._powers(x, y)
        each = (u.unsqueeze(1) * v).flatten(0, 1).movedim(0, -1) @ _monomials(self._degrees).to(
            u
        ).mT
        by_term = dict(
            zip(map(called, terms_of(self._degrees)), torch.split(each, 1, -1), strict=True)
        )
        return {name: by_term[name.split(".")[2]] for name in self.probes}

    def _powers(self, x: Tensor, y: Tensor) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
        return powers(x, self.half[0], self.degree), powers(y, self.half[1], self.degree)


_PROBES = ("board_scale.x.probe", "board_scale.y.probe")


@cache
def _unknown(axis: str, term: Term, half: float) -> Unknown:
    sigma = PRINT_UNEVEN.sigma * half * (DEGREES[0] / sum(term)) ** 2
    return Unknown(Param(f"board_scale.{axis}.{called(term)}", "m", PRINT_UNEVEN.scale), sigma)


@cache
def _monomials(degrees: tuple[int, ...]) -> Tensor:
    """(n, orders^2) of each term by the products u^a v^b."""
    return torch.from_numpy(monomials(terms_of(degrees))).flatten(1)
