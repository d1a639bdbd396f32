"""An effect without a name: a smooth free-form displacement over what organises the residual, the board or the image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.optics.params import Param, Values
from calib.optics.path import Path

WAVES = 9
"""Cosines along each direction, the constant one among them."""
FIRST_SIZES = {"board": 2e-4, "image": 0.5}
"""m and px."""
FIRST_KNEE = 2.0
SIZES = tuple(10.0 ** (step / 3) for step in range(-8, 4))
"""Times the first size."""
KNEES = (1.0, 2.0, 4.0, 8.0)


@dataclass(frozen=True, slots=True)
class FreeField(Effect):
    """Products of cosines, as of a discrete cosine transform, for each of the two directions."""

    over: Literal["board", "image"]
    low: tuple[float, float]
    """m or px, of the area."""
    high: tuple[float, float]
    size: float
    """m or px: standard deviation of the displacement's lowest waves."""
    knee: float
    """The wave from which on they are the smaller the finer they are."""
    name: ClassVar[str] = "free_field"
    has_cause: ClassVar[bool] = False
    advice: ClassVar[str] = "turn the board by 90 degrees in some views, and move it over the whole picture"

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        board = there.board
        half = board.half[0] + board.square / 2, board.half[1] + board.square / 2
        return (
            cls("board", (-half[0], -half[1]), half, FIRST_SIZES["board"], FIRST_KNEE),
            cls("image", (-0.5, -0.5), (there.width - 0.5, there.height - 0.5), FIRST_SIZES["image"], FIRST_KNEE),
        )

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        unit, scale = ("m", 1e-5) if self.over == "board" else ("px", 0.1)
        return tuple(Unknown(Param(f"free_field.{self.over}.{axis}", unit, scale, (WAVES**2,)), self.size) for axis in "xy")

    @property
    def form(self) -> str:
        return self.over

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.unknowns)

    def apply(self, path: Path) -> Path:
        if self.over == "board":
            return replace(path, target=replace(path.target, prints=(*path.target.prints, self)))
        return replace(path, adjustments=(*path.adjustments, self))

    def tuned(self, information: NDArray[np.float64], score: NDArray[np.float64]) -> Self:
        """With the size and the knee of the largest evidence: of the residual's probability, the field itself integrated out."""
        forms = [replace(self, size=FIRST_SIZES[self.over] * factor, knee=knee) for factor in SIZES for knee in KNEES]
        mine = self._falls(torch.float64).numpy().ravel() * self.unknowns[0].param.scale

        def evidence(form: Self) -> float:
            spread = np.tile(form.size * form._falls(torch.float64).numpy().ravel() / mine, 2)  # of my parameters over their scales
            weighed = np.eye(len(score)) + spread[:, None] * information * spread
            scaled = spread * score
            return float(scaled @ np.linalg.solve(weighed, scaled) - np.linalg.slogdet(weighed)[1]) / 2

        return max(forms, key=evidence)

    def _falls(self, dtype: torch.dtype) -> Tensor:
        """(WAVES, WAVES) how much of each wave there is."""
        order = torch.arange(WAVES, dtype=dtype)
        return 1 / (1 + (order[:, None] ** 2 + order**2) / self.knee**2)

    def shift(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """(...) m or px by which a point is moved."""
        u, v = ((at - low) / (high - low) for at, low, high in zip((x, y), self.low, self.high, strict=True))
        order = torch.arange(WAVES, dtype=x.dtype, device=x.device) * torch.pi
        along_x, along_y = (torch.cos(at.unsqueeze(-1) * order) for at in (u, v))  # (..., WAVES)
        falls = self._falls(x.dtype).to(x.device)
        waves = ((along_x.unsqueeze(-1) * along_y.unsqueeze(-2)) * falls).flatten(-2)  # (..., WAVES^2)
        right, down = ((values[param.name] * waves).sum(-1) for param in self.params)
        return right, down

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        return pixels + torch.stack(self.shift(pixels[..., 0], pixels[..., 1], values), -1), values
