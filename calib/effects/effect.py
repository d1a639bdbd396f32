"""What an effect is: a change of the ray path with parameters of its own that do nothing at their
neutral values.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.board import Board
from calib.session.shutter import Shutter
from calib.session.tolerances import Tolerance


@dataclass(frozen=True, slots=True)
class Unknown:
    """A parameter of an effect."""

    param: Param
    sigma: float
    """How large it may well be, in the unit: the prior's standard deviation around `start`."""
    neutral: float = 0.0
    """Where the effect is not there."""
    start: float | None = None
    """Where a fit with it begins, and the middle of the prior; None: at the neutral value."""
    shifts: tuple[str, ...] = ()
    """The declared numbers, by their names among the values, that it is an increment of: what
    people are shown is their sum.
    """
    relative: bool = False
    """Whether it is a fraction of them."""

    @staticmethod
    def of(
        name: str, tolerance: Tolerance, shifts: tuple[str, ...] = (), *, relative: bool = False
    ) -> Unknown:
        """A scalar whose neutral value is zero, with the prior of a physical quantity."""
        return Unknown(
            Param(name, tolerance.unit, tolerance.scale),
            tolerance.sigma,
            shifts=shifts,
            relative=relative,
        )

    @property
    def begin(self) -> float:
        return self.neutral if self.start is None else self.start


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What an effect may go by."""

    board: Board
    width: int
    """px"""
    height: int
    """px"""
    path: Path
    values: Values
    """Of the path as it is fitted."""
    estimated: frozenset[str] = frozenset()
    """Parameters that the fit estimates already."""
    shutter: Shutter | None = None
    """None: the session does not say."""
    place: Tensor | None = None
    """(2,) chart coordinates of the glass where the residual asks for a finer relief; None where it
    was not asked for.
    """


SIZES = (0.03, 0.1, 0.3, 1.0)
"""Of what single views have for themselves, over what is possible at most: hands that hold a board
still do not move it by as much.
"""


class Effect(Protocol):
    """One physical cause of error, as a change of the ray path."""

    name: ClassVar[str]
    about: ClassVar[str]
    """Where it sits: the end of "something about ..."."""
    advice: ClassVar[str]
    """What to do to tell it from its like, where no one pose of the board does: the end of "To
    separate them, ...".
    """
    per_view: ClassVar[str] = ""
    """The part of a view's own parameters that it adds, of `calib.optics.board_target.VIEW_BLOCKS`;
    empty where all views share what it has.
    """
    judged_by_score: ClassVar[bool] = True
    """False where its neutral point says little of what it does: then it is always fitted."""
    needs_place: ClassVar[bool] = False
    """Whether it asks where on the glass the residual wants a finer relief, which takes a while to
    find.
    """
    on_cover: ClassVar[bool] = False
    """Whether it changes a cover: where there is none, or no more, there is no such effect."""
    has_cause: ClassVar[bool] = True
    """False where it mends an error whose cause it does not name."""
    beforehand: ClassVar[float] = 1.0
    """How probable it is before any view is looked at, over a cause that may always be there: less
    where a user would have said so.
    """

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        """The forms in which it may be present there; none where it cannot be."""
        ...

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Its parameters, those of single views aside."""
        ...

    @property
    def form(self) -> str:
        """Which of its forms this is, in a word; empty where it has but one."""
        return ""

    def tuned(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """The same with a prior that suits a residual, where an effect leaves its prior to the
        data.

        Args:
            information: (k, k) on the effect's parameters over their scales, what the fit estimates
                already being unknown.
            score: (k,) of them: minus half the gradient of the sum of squares.
        """
        del information, score
        return self

    def alternatives(self) -> tuple[Self, ...]:
        """The same with fewer and with more parameters, or a narrower and a wider prior of what
        single views have, the simplest first, where a fit's evidence is to choose among them; else
        none.
        """
        return ()

    def displaced(self, values: Values) -> tuple[Values, ...]:
        """Where some of the path's values may stand once it is there, if a fit without it has made
        up for it.
        """
        del values
        return ()

    def apply(self, path: Path) -> Path:
        """The path with it."""
        ...


def possible(effect: Effect | type[Effect], path: Path) -> bool:
    """Whether there can be such an effect there."""
    return bool(path.cover) or not effect.on_cover


def linear_evidence(
    information: NDArray[np.float64], score: NDArray[np.float64], spread: NDArray[np.float64]
) -> float:
    """The logarithm of the residual's probability with an effect, over that without it, its
    parameters integrated out, to first order.

    Args:
        information: (k, k) as `Effect.tuned` has it.
        score: (k,) likewise.
        spread: (k,) the prior's standard deviation of each parameter, over its scale.
    """
    weighed = np.eye(len(spread)) + spread[:, None] * information * spread
    scaled = spread * score
    return float(scaled @ np.linalg.solve(weighed, scaled) - np.linalg.slogdet(weighed)[1]) / 2


E = TypeVar("E", bound=Effect)


def most_evident(
    forms: Sequence[E], information: NDArray[np.float64], score: NDArray[np.float64]
) -> E:
    """The form of the largest evidence, to first order. Each begins with the parameters of the
    simpler ones, to which (k, k) information and the (k,) score belong as in `Effect.tuned`; all
    have numbers as parameters, not fields.
    """

    def evidence(form: E) -> float:
        spread = np.array([unknown.sigma / unknown.param.scale for unknown in form.unknowns])
        count = len(spread)
        return linear_evidence(information[:count, :count], score[:count], spread)

    return max(forms, key=evidence)
