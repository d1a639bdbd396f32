"""The window of an undistorted picture: its size, and the area of the bare pinhole's image that it
shows.
"""

from __future__ import annotations

from dataclasses import dataclass

from calib.errors import InputError
from calib.session.camera import MAX_PIXELS


@dataclass(frozen=True, slots=True)
class Window:
    """Pixel (u, v) of the picture is pixel corner + zoom * (u, v) of the bare pinhole camera."""

    width: int
    """px, of the picture."""
    height: int
    corner: tuple[float, float] = (0.0, 0.0)
    """px of the bare pinhole camera."""
    zoom: tuple[float, float] = (1.0, 1.0)
    """px of the bare pinhole camera per px of the picture, along x and y."""

    def __post_init__(self) -> None:
        if self.width * self.height > MAX_PIXELS:
            raise InputError(
                f"a picture of {self.width}x{self.height} px is too large for memory: write a width"
                f" and height that make at most {MAX_PIXELS:,} pixels."
            )
