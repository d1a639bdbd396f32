"""The exposure of rays, which is an input of the ray path beside its values."""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True, slots=True)
class Exposure:
    """The time at which the pixel of each ray is exposed, from -0.5 to 0.5; 0 is the middle, and
    the view that it is of.
    """

    time: Tensor
    """(...): the time within the session."""
    line: Tensor
    """(...): the time within the readout of the picture, from the first line to the last."""
    view: Tensor | None = None
    """(...) int64: the index of the view among those of the calibration; None for other views."""

    def __getitem__(self, rows: Tensor | slice) -> Exposure:
        view = None if self.view is None else self.view[rows]
        return Exposure(self.time[rows], self.line[rows], view)

    def to(self, device: str) -> Exposure:
        """Return the same on another device."""
        view = None if self.view is None else self.view.to(device)
        return Exposure(self.time.to(device), self.line.to(device), view)


MIDDLE: Exposure | None = None
"""The exposure of rays in the middle of the session and of the readout. The maps are for this
time.
"""
