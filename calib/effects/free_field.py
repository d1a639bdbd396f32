"""An effect without a name: a smooth free-form displacement over what organises the residual, the board or the image."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Literal, Self

import torch
from torch import Tensor

from calib.effects.effect import Effect, Surroundings, Unknown
from calib.optics.params import Param, Values
from calib.optics.path import Path

WAVES = 9
"""Cosines along each direction, the constant one among them."""
BOARD_SIGMA, IMAGE_SIGMA = 2e-4, 0.5
"""m and px: of the displacement's lowest waves."""


@dataclass(frozen=True, slots=True)
class FreeField(Effect):
    """Products of cosines, as of a discrete cosine transform, for each of the two directions."""

    over: Literal["board", "image"]
    low: tuple[float, float]
    """m or px, of the area."""
    high: tuple[float, float]
    name: ClassVar[str] = "free_field"

    @classmethod
    def propose(cls, there: Surroundings) -> tuple[Self, ...]:
        board = there.board
        half = board.columns / 2 * board.square, board.rows / 2 * board.square
        return (
            cls("board", (-half[0], -half[1]), half),
            cls("image", (-0.5, -0.5), (there.width - 0.5, there.height - 0.5)),
        )

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        on_board = self.over == "board"
        unit, scale, sigma = ("m", 1e-5, BOARD_SIGMA) if on_board else ("px", 0.1, IMAGE_SIGMA)
        return tuple(Unknown(Param(f"free_field.{self.over}.{axis}", unit, scale, (WAVES**2,)), sigma) for axis in "xy")

    @property
    def params(self) -> tuple[Param, ...]:
        return tuple(unknown.param for unknown in self.unknowns)

    def apply(self, path: Path) -> Path:
        if self.over == "board":
            return replace(path, target=replace(path.target, prints=(*path.target.prints, self)))
        return replace(path, adjustments=(*path.adjustments, self))

    def shift(self, x: Tensor, y: Tensor, values: Values) -> tuple[Tensor, Tensor]:
        """(...) m or px by which a point is moved."""
        u, v = ((at - low) / (high - low) for at, low, high in zip((x, y), self.low, self.high, strict=True))
        order = torch.arange(WAVES, dtype=x.dtype, device=x.device) * torch.pi
        along_x, along_y = (torch.cos(at.unsqueeze(-1) * order) for at in (u, v))  # (..., WAVES)
        falls = 1 / (1 + (order[:, None] ** 2 + order**2) / torch.pi**2 / 4)  # smooth rather than rough
        waves = ((along_x.unsqueeze(-1) * along_y.unsqueeze(-2)) * falls).flatten(-2)  # (..., WAVES^2)
        right, down = ((values[param.name] * waves).sum(-1) for param in self.params)
        return right, down

    def __call__(self, pixels: Tensor, values: Values) -> tuple[Tensor, Values]:
        return pixels + torch.stack(self.shift(pixels[..., 0], pixels[..., 1], values), -1), values
