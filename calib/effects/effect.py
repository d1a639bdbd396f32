"""The protocol of an effect: a change of the ray path with parameters that do nothing at their
neutral values.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import ClassVar, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.board import Board
from calib.session.shutter import Shutter
from calib.session.tolerances import Tolerance


@dataclass(frozen=True, slots=True)
class EffectParameter:
    """A parameter of an effect."""

    param: Param
    sigma: float
    """The prior's standard deviation around `start`, in the unit."""
    neutral: float = 0.0
    """The value at which the effect is absent."""
    start: float | None = None
    """The start of a fit and the mean of the prior; None means the neutral value."""
    shifts: tuple[str, ...] = ()
    """The names of the declared values that this parameter is added to. Reports show the sums."""
    relative: bool = False
    """True if the parameter is a fraction of these values, not an increment."""
    lowest: float = -math.inf
    """The smallest possible value, in the unit. A fit may pass it, but then explains nothing."""

    @staticmethod
    def of(
        name: str, tolerance: Tolerance, shifts: tuple[str, ...] = (), *, relative: bool = False
    ) -> EffectParameter:
        """Return a scalar parameter with neutral value zero and the prior of a physical
        quantity.
        """
        return EffectParameter(
            Param(name, tolerance.unit, tolerance.scale),
            tolerance.sigma,
            shifts=shifts,
            relative=relative,
        )

    @property
    def initial(self) -> float:
        """The start of a fit, in the unit."""
        return self.neutral if self.start is None else self.start


@dataclass(frozen=True, slots=True)
class PlaceOnGlass:
    """A place on the cover's outer surface where a bump may be."""

    chart: tuple[float, float]
    """The two chart coordinates."""
    metres: tuple[float, float]
    """m on the glass per unit of these."""
    width: float
    """m: the width of the bump."""


@dataclass(frozen=True, slots=True)
class EffectContext:
    """The facts about a session and its fit that decide which forms of an effect are possible."""

    board: Board
    width: int
    """px"""
    height: int
    """px"""
    path: Path
    values: Values
    """The values of the path in the current fit."""
    estimated: frozenset[str] = frozenset()
    """Parameters that the fit already estimates."""
    shutter: Shutter | None = None
    """None if the session does not state the shutter."""
    place: PlaceOnGlass | None = None
    """The place where a bump explains the residual best; None if nobody searched for it."""


EACH_VIEW = "each_view"
"""The word for numbers that differ in every view."""
BLOCK_SCALES = (0.03, 0.1, 0.3, 1.0)
"""The sizes of per-view blocks that a fit tries, over the largest plausible size: hands that hold a
board still move it by less.
"""


class Effect(Protocol):
    """A physical cause of error, as a change of the ray path."""

    name: ClassVar[str]
    description: ClassVar[str]
    """One plain sentence for people who do not know the effect by its name."""
    legend: ClassVar[Mapping[str, str]] = MappingProxyType({})
    """Plain words for its numbers, by the end of their names; those of "" are for all others."""
    about: ClassVar[str]
    """The component that it belongs to: the end of "something about ..."."""
    advice: ClassVar[str]
    """The advice for separating it from similar effects if no single pose of the board does: the
    end of "To separate them, ...".
    """
    per_view: ClassVar[str] = ""
    """The block of `calib.optics.view_blocks.VIEW_BLOCKS` that it adds to every view; empty if all
    views share its parameters.
    """
    varies: ClassVar[str] = ""
    """The way in which its numbers differ from view to view, in a word of
    `calib.effects.varying.MANNERS`; empty if they do not.
    """
    is_sum: ClassVar[bool] = False
    """True if its numbers are terms of a sum, which may cancel: none by itself says whether the
    effect is possible.
    """
    judged_by_score: ClassVar[bool] = True
    """False if the gradient at the neutral point says little about the effect: then the diagnosis
    always fits it.
    """
    needs_place: ClassVar[bool] = False
    """True if it needs `EffectContext.place`, which takes a while to find."""
    on_cover: ClassVar[bool] = False
    """True if it changes the cover, so that it cannot occur without one."""
    has_cause: ClassVar[bool] = True
    """False if it corrects an error without naming its cause."""
    prior_odds: ClassVar[float] = 1.0
    """The prior odds of the effect against a cause that every session may have, below 1 for a cause
    that a user would have declared.
    """

    @classmethod
    def propose(cls, context: EffectContext) -> tuple[Self, ...]:
        """Return the forms of the effect that are possible in this context; none if it cannot
        occur.
        """
        ...

    @property
    def effect_parameters(self) -> tuple[EffectParameter, ...]:
        """The parameters that all views share."""
        ...

    @property
    def form(self) -> str:
        """The name of this form, in one word; empty if the effect has one form only."""
        return ""

    def tune(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """Return the effect with the prior or the form that explains a residual best, if the effect
        leaves that choice to the data; else the effect itself.

        Args:
            information: (k, k) information about the effect's parameters over their scales, after
                the elimination of all parameters that the fit already estimates.
            score: (k,) half the gradient of the sum of squares by them.
        """
        del information, score
        return self

    def alternatives(self) -> tuple[Self, ...]:
        """Return the forms among which a fit's evidence is to choose, the simplest first: with
        fewer and with more parameters, or with a narrower and a wider prior of a per-view block.
        Return none if there is nothing to choose.
        """
        return ()

    def alternative_starts(self, values: Values) -> tuple[Values, ...]:
        """Return alternative starts for some of the path's values, for a fit with this effect after
        a fit without it, whose values may have compensated for it.
        """
        del values
        return ()

    def apply(self, path: Path) -> Path:
        """Return the path with the effect."""
        ...


def is_possible(effect: Effect | type[Effect], path: Path) -> bool:
    """True if the effect can occur on this path."""
    return bool(path.cover) or not effect.on_cover


def log_bayes_factor(
    information: NDArray[np.float64], score: NDArray[np.float64], spread: NDArray[np.float64]
) -> float:
    """Return the logarithm of the Bayes factor for an effect: the residual's probability with the
    effect, its parameters integrated out, over the probability without it, to first order.

    Args:
        information: (k, k), as in `Effect.tune`.
        score: (k,), as in `Effect.tune`.
        spread: (k,) the prior's standard deviation of each parameter, over its scale.
    """
    posterior = np.eye(len(spread)) + spread[:, None] * information * spread
    scaled = spread * score
    return float(scaled @ np.linalg.solve(posterior, scaled) - np.linalg.slogdet(posterior)[1]) / 2


def scaled_prior_sigmas(effect: Effect) -> NDArray[np.float64]:
    """Return (k,) the prior's standard deviation of each scalar parameter, over its scale."""
    return np.array([u.sigma / u.param.scale for u in effect.effect_parameters])


E = TypeVar("E", bound=Effect)


def select_form(
    forms: Sequence[E], information: NDArray[np.float64], score: NDArray[np.float64]
) -> E:
    """Return the form with the largest evidence, to first order. All parameters are scalars, and
    the parameters of each form begin with those of the simpler forms; the (k, k) information and
    the (k,) score of `Effect.tune` are those of the richest form.
    """

    def evidence(form: E) -> float:
        spread = scaled_prior_sigmas(form)
        count = len(spread)
        return log_bayes_factor(information[:count, :count], score[:count], spread)

    return max(forms, key=evidence)
