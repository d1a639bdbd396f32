"""The setup of a fit: the board, the camera and its cover as they are known before it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from calib.errors import InputError
from calib.fit_record.request import Settings
from calib.optics.params import Values
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.freeing import AUTO, free_parameters
from calib.session.numbers import numbers_of


@dataclass(frozen=True, slots=True)
class Setup:
    """The board, camera and cover as they are known before the fit."""

    board: Board
    camera: Camera
    intrinsics: Intrinsics
    cover: Cover
    intrinsics_are_final: bool = False
    """True if no joint fit must estimate these intrinsics again (`FitInputs`)."""
    initial: Mapping[str, float] = field(default_factory=dict)
    """The values of unknown numbers with which a fit starts, in SI units or px, by their names in
    the ray path; other numbers start at the means of their priors.
    """
    bare_lens: Mapping[str, float] = field(default_factory=dict)
    """The unknown intrinsics that `calibrate_bare` finds in the covered views as if there were no
    cover, focal lengths and principal point in px.
    """

    def with_tolerances(self, settings: Settings) -> Setup:
        """Return the setup with a tolerance for each declared number that the settings estimate.

        Raises:
            InputError: the cover has no number of such a name, or the method needs a number that is
                unknown.
        """
        if settings.method == "paper":
            for name, number in numbers_of(self.intrinsics, self.cover).items():
                if number.unknown:
                    raise InputError(
                        f"--method paper fits no number, and {name} is unknown: write its value in"
                        " session.yaml, or leave out --method."
                    )
            return self
        names = settings.free
        if self.cover.shape == "none":  # stated intrinsics are held unless they have a tolerance
            names = tuple(name for name in names if name != AUTO)
        intrinsics, cover = free_parameters(self.intrinsics, self.cover, names)
        return replace(self, intrinsics=intrinsics, cover=cover)

    def initial_values(self, values: Values) -> dict[str, Tensor]:
        """Return the values of a path with those of `initial` in their place."""
        initial = {name: torch.tensor(v, dtype=torch.float64) for name, v in self.initial.items()}
        return {name: initial.get(name, value) for name, value in values.items()}
