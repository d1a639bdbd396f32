"""The print is longer in one direction than in the other, its directions may not be at right
angles, and its scale may vary over the sheet. The scale that both directions share is the board's
size, which no view can measure.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from typing import ClassVar, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import Effect, EffectContext, EffectParameter, select_form
from calib.optics.board_polynomials import Term, monomials, powers, term_name, terms_of_degrees
from calib.optics.board_terms import PrintShift
from calib.optics.linear_term import contract
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.tolerances import PRINT_SHEAR, PRINT_STRETCH, PRINT_UNEVEN

STRETCH = EffectParameter.of("board_scale.x_over_y", PRINT_STRETCH)
SHEAR = EffectParameter.of("board_scale.shear", PRINT_SHEAR)
DEGREES = (2, 3)
"""The degrees of an uneven scale: a stretch that grows along the sheet, and one that is largest at
the middle or at the edges.
"""


@dataclass(frozen=True, slots=True)
class BoardScale(Effect):
    """A print whose x is longer by half of the stretch and whose y is shorter by half of it.

    In a sheared print, each direction is turned towards the other by half of the angle. In an
    uneven print, corners move along x and along y by Legendre's P_i(u) P_j(v), i + j = 2, 3; a
    term's name is i times x, then j times y. All other terms of degrees 0 and 1 belong to the pose
    and to the board's size.
    """

    sheared: bool = False
    degree: int = 1
    """The degree of an uneven scale; 1 if the scale is even."""
    half: tuple[float, float] = (1.0, 1.0)
    """m, half the distance between the outermost corners along x and y, where u and v are 1."""
    name: ClassVar[str] = "board_scale"
    description: ClassVar[str] = "The print is longer in one direction than in the other."
    legend: ClassVar[Mapping[str, str]] = {
        "x_over_y": "the print is longer along its rows by this part.",
        "shear": "rows and columns are this far from a right angle.",
        "": "the print is longer at one place than at another.",
    }
    is_sum: ClassVar[bool] = True
    about: ClassVar[str] = "the board"
    advice: ClassVar[str] = "turn the board by 90 degrees in half of the views"

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        return (cls(True, DEGREES[-1], context.board.half),) if context.board.is_flat else ()

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        linear = (STRETCH, SHEAR) if self.sheared else (STRETCH,)
        return (
            *linear,
            *(
                _parameter(axis, term, max(self.half))
                for degree in self._degrees
                for axis in "xy"
                for term in terms_of_degrees((degree,))
            ),
        )

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(parameter.param for parameter in self.effect_parameters)

    @property
    def _degrees(self) -> tuple[int, ...]:
        return tuple(degree for degree in DEGREES if degree <= self.degree)

    def alternatives(self) -> tuple[Self, ...]:
        linear = replace(self, sheared=False, degree=1), replace(self, sheared=True, degree=1)
        return (*linear, *(replace(self, sheared=True, degree=degree) for degree in DEGREES))

    def tune(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """Return the form with the largest evidence, to first order."""
        richest = self.sheared, self.degree
        return select_form(
            [form for form in self.alternatives() if (form.sheared, form.degree) <= richest],
            information,
            score,
        )

    def apply(self, path: Path) -> Path:
        return replace(path, target=replace(path.target, prints=(*path.target.prints, self)))

    def shift_corners(self, x: Tensor, y: Tensor, values: Values) -> PrintShift:
        """Return the shifts of corners at nominal board coordinates."""
        half = values[STRETCH.param.name] / 2
        angle = values[SHEAR.param.name] / 2 if self.sheared else half.new_zeros(())
        with torch.no_grad():
            stretch_slope, shear_slope = half.clone(), angle.clone()
        shift_x, shift_y = half * x + angle * y, angle * x - half * y
        if not self._degrees:
            slopes = ((stretch_slope, shear_slope), (shear_slope, -stretch_slope))
            return PrintShift(shift_x, shift_y, slopes)
        uneven_x, uneven_y = self._uneven(x, y, values)
        return PrintShift(
            shift_x + uneven_x[0],
            shift_y + uneven_y[0],
            (
                (stretch_slope + uneven_x[1], shear_slope + uneven_x[2]),
                (shear_slope + uneven_y[1], uneven_y[2] - stretch_slope),
            ),
        )

    def _uneven(self, x: Tensor, y: Tensor, values: Values) -> list[tuple[Tensor, Tensor, Tensor]]:
        """Return the uneven scale's (...) m shift along each direction, with its slopes by x and by
        y.
        """
        with torch.no_grad():
            (u, inside_u), (v, inside_v) = self._powers(x, y)
            order = torch.arange(1, self.degree + 1).to(u).reshape(-1, *[1] * x.ndim)
            rise_u = u[:-1] * order * (inside_u / self.half[0])
            rise_v = v[:-1] * order * (inside_v / self.half[1])
        shifts = []
        for probe in _PROBES:
            sizes = torch.stack(
                [values[name] for name, acts_by in self.probes.items() if acts_by == probe], -1
            )
            table = (sizes @ _monomials(self._degrees).to(sizes)).reshape(
                *sizes.shape[:-1], self.degree + 1, self.degree + 1
            )
            by_power = contract(u, table)
            shift = (by_power * v).sum(0)
            with torch.no_grad():
                slope_x = (contract(rise_u, table[..., 1:, :]) * v).sum(0)
                slope_y = (by_power[1:] * rise_v).sum(0)
            shifts.append((shift + values[probe] if probe in values else shift, slope_x, slope_y))
        return shifts

    @property
    def probes(self) -> dict[str, str]:
        """The probes of the uneven scale's parameters. Stretch and shear act along both directions,
        so they have none.
        """
        return {
            param.name: _PROBES["xy".index(param.name.split(".")[1])]
            for param in self.params
            if param.name.count(".") == 2
        }

    def weights(self, x: Tensor, y: Tensor) -> dict[str, Tensor]:
        """Return the weights of `LinearTerm`."""
        if not self._degrees:
            return {}
        (u, _), (v, _) = self._powers(x, y)
        products = (u.unsqueeze(1) * v).flatten(0, 1).movedim(0, -1)
        weights = products @ _monomials(self._degrees).to(u).mT
        by_term = dict(
            zip(
                map(term_name, terms_of_degrees(self._degrees)),
                torch.split(weights, 1, -1),
                strict=True,
            )
        )
        return {name: by_term[name.split(".")[2]] for name in self.probes}

    def _powers(self, x: Tensor, y: Tensor) -> tuple[tuple[Tensor, Tensor], tuple[Tensor, Tensor]]:
        return powers(x, self.half[0], self.degree), powers(y, self.half[1], self.degree)


_PROBES = ("board_scale.x.probe", "board_scale.y.probe")


@cache
def _parameter(axis: str, term: Term, half: float) -> EffectParameter:
    sigma = PRINT_UNEVEN.sigma * half * (DEGREES[0] / sum(term)) ** 2
    return EffectParameter(
        Param(f"board_scale.{axis}.{term_name(term)}", "m", PRINT_UNEVEN.scale), sigma
    )


@cache
def _monomials(degrees: tuple[int, ...]) -> Tensor:
    """Return the (n, orders^2) coefficients of the products u^a v^b in each term."""
    return torch.from_numpy(monomials(terms_of_degrees(degrees))).flatten(1)
