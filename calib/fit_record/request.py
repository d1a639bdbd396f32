"""The request of a fit: its options, those of its command line, and its inputs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from calib.session.freeing import AUTO

IntrinsicsSource = Literal["session.yaml", "bare", "prior", "views"]
"""The source of the intrinsics with which a fit starts: the session's description, its pictures
without the cover, its fleet's prior, or the fitted views themselves.
"""


EVEN_GRID = (1, 1)
"""The grid that stands for even glass: the mean of its height is thickness."""


@dataclass(frozen=True, slots=True)
class Settings:
    """The options of a fit."""

    method: Literal["joint", "paper"] = "joint"
    grid: tuple[int, int] | None = (12, 12)
    """Centres of the relief around and along the cover (horizontally and vertically for an upright
    cone). None: by held-out error.
    """
    steps: int = 1000
    """Gradient steps of the paper's procedure."""
    exact_hit: bool = True
    """False neglects that the relief moves the hit point, as the paper does."""
    free: tuple[str, ...] = (AUTO,)
    """Names of `calib.session.freeing.option_names`: the declared numbers that the joint method
    estimates, near their declared values.
    """
    folds: int = 0
    """Number of folds of the cross-validation; 0 for none."""
    flat_board: bool = False
    """True to take the board as flat and evenly printed; False to estimate its bend and its print
    where the views show them.
    """

    @property
    def is_even(self) -> bool:
        """True if the grid has one centre, which stands for even glass."""
        return self.grid == EVEN_GRID

    @property
    def estimates_bend(self) -> bool:
        """True if the fit estimates the board's bend; the paper's method does not."""
        return self.method == "joint" and not self.flat_board


@dataclass(frozen=True, slots=True)
class CommandOptions:
    """The options of `calib fit` that are not the fit's own."""

    effects: tuple[str, ...] = ()
    """Names of the effects to add; `auto` alone for a diagnosis."""
    depths: tuple[float, ...] = ()
    """m, of the maps."""


@dataclass(frozen=True, slots=True)
class Provenance:
    """The inputs of a fit, and the programs that made it. None stands for what is not recorded."""

    session: str | None = None
    """The path of the session's folder."""
    session_sha256: str | None = None
    """The SHA-256 of the listing of the session's files (`calib.fitting.provenance`)."""
    finished: str | None = None
    """The time in UTC, as ISO 8601."""
    python: str | None = None
    """The version of Python."""
    machine: str | None = None
    """The operating system and the processor."""
    packages: Mapping[str, str] = field(default_factory=dict)
    """The versions of the packages that compute, by name."""


@dataclass(frozen=True, slots=True)
class FitRequest:
    """The request that a calibration records. None stands for what is not recorded."""

    settings: Settings | None = None
    """The options, with the chosen grid if the fit chose it."""
    command: CommandOptions | None = None
    """None if a program called the library."""
    provenance: Provenance | None = None

    @property
    def free(self) -> tuple[str, ...]:
        """The names of the numbers to estimate; empty if the settings are not recorded."""
        return self.settings.free if self.settings else ()

    @property
    def session(self) -> str:
        """The path of the session's folder, or a placeholder for it in commands."""
        return (self.provenance and self.provenance.session) or "SESSION"
