"""The exposure of rays: an input of the ray path beside its values."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True, slots=True)
class Exposure:
    """The time at which the pixel of each ray is exposed, from -0.5 to 0.5; 0 is the middle."""

    time: Tensor
    """(...): the time within the session."""
    line: Tensor
    """(...): the time within the readout of the picture, from the first line to the last."""

    def __getitem__(self, rows: Tensor | slice) -> Exposure:
        return Exposure(self.time[rows], self.line[rows])

    def to(self, device: str) -> Exposure:
        """Return the same on another device."""
        return Exposure(self.time.to(device), self.line.to(device))


MIDDLE: Exposure | None = None
"""The exposure of rays in the middle of the session and of the readout. The maps are for this
time.
"""
