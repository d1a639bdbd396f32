"""What an effect is: a change of the ray path with numbers of its own that do nothing at their neutral values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.session.board import Board


@dataclass(frozen=True, slots=True)
class Unknown:
    """A number of an effect."""

    param: Param
    sigma: float
    """How large it may well be, in the unit: the prior's standard deviation around `start`."""
    neutral: float = 0.0
    """Where the effect is not there."""
    start: float | None = None
    """Where a fit with it begins, and the middle of the prior; None: at the neutral value."""

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
    """Numbers that the fit estimates already."""
    suspect: Tensor | None = None
    """(2,) chart coordinates of the glass where the residual asks for a finer relief."""


class Effect(Protocol):
    """One physical cause of error, as a change of the ray path."""

    name: ClassVar[str]
    per_view: ClassVar[bool] = False
    """Whether it has numbers of every single view."""
    judged_by_score: ClassVar[bool] = True
    """False where its neutral point says little of what it does: then it is always fitted."""

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        """The forms in which it may be present there; none where it cannot be."""
        ...

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Its numbers, those of single views aside."""
        ...

    def tuned(self, information: NDArray[np.float64], pull: NDArray[np.float64]) -> Self:
        """The same with a prior that suits a residual, where an effect leaves its prior to the data.

        Args:
            information: (k, k) on the effect's numbers over their scales, what the fit estimates already being unknown.
            pull: (k,) of the residual on them.
        """
        del information, pull
        return self

    def apply(self, path: Path) -> Path:
        """The path with it."""
        ...
