"""Colour behind a cover: each channel of a picture has rays of its own, because glass and water
bend blue light more than red light.

The calibration's own rays are those of green light. All channels have the same straight picture, so
that their undistorted pictures coincide.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from calib.apply.undistorter import Depth, Image, Undistorter
from calib.calibration import Calibration
from calib.errors import InputError
from calib.fitting.corner_range import corners_at
from calib.session.dispersion import BLUE, GREEN, RED

Array = NDArray[np.float64]

NO_DISPERSION = (
    "the cover's glass has one refractive index for all colours: fit the session again with its"
    " Abbe number in session.yaml, such as refractive_index: {value: 1.49, abbe: 57}."
)
COLUMNS, ROWS = 9, 7
"""The number of places along each side of the picture at which fringes are predicted."""


def check_dispersion(calibration: Calibration) -> None:
    """Raise InputError unless the calibration says how colours differ."""
    if not calibration.cover.has_dispersion:
        raise InputError(NO_DISPERSION)


def channel_calibration(calibration: Calibration, channel: str) -> Calibration:
    """Return the calibration whose rays are those of a channel, one of dispersion.CHANNELS."""
    return replace(calibration, cover=calibration.cover.in_channel(channel))


class ColourUndistorter(Undistorter):
    """An undistorter of colour pictures that removes the cover's colour fringes. Points and `field`
    are those of green light.
    """

    _red: Undistorter
    _blue: Undistorter

    def __init__(
        self, calibration: Calibration, depth: Depth | None = None, **options: Any
    ) -> None:
        """The arguments are those of Undistorter.

        Raises:
            InputError: the calibration does not say how colours differ.
        """
        check_dispersion(calibration)
        super().__init__(channel_calibration(calibration, GREEN), depth, **options)
        same_picture: dict[str, Any] = {
            "camera_matrix": self.camera_matrix,
            "size": self.size,
            **{key: options[key] for key in ("near", "interpolation") if key in options},
        }
        red = channel_calibration(calibration, RED)
        blue = channel_calibration(calibration, BLUE)
        self._red = Undistorter(red, self.depth, **same_picture)
        self._blue = Undistorter(blue, self.depth, **same_picture)
        self._show_common_pixels()

    def at(self, depth: Depth) -> ColourUndistorter:
        copy = cast(ColourUndistorter, super().at(depth))
        copy._red, copy._blue = self._red.at(depth), self._blue.at(depth)
        copy._show_common_pixels()
        return copy

    def undistort(self, image: Image, into: Image | None = None) -> Image:
        """Return the undistorted picture, as `Undistorter.undistort`; InputError for a grey one."""
        if np.ndim(image) != 3:
            raise InputError("a grey picture has no colour fringes: leave --colour out.")
        straight = super().undistort(image, into)
        for place, undistorter in ((0, self._blue), (2, self._red)):
            plane = cast(Image, np.ascontiguousarray(image[..., place]))
            straight[..., place] = undistorter.undistort(plane)
        if self._holes:
            straight[~self.valid] = 0
        return straight

    def _show_common_pixels(self) -> None:
        """Leave out pixels that not all channels see, which would be coloured."""
        self.valid = self.valid & self._red.valid & self._blue.valid
        self._holes = not self.valid.all()


@dataclass(frozen=True, slots=True)
class ColourFringes:
    """The predicted place of red light against blue light from one white point, at one depth."""

    depth: float
    """m: the point's depth, or its distance for a wide lens."""
    columns: Array
    """(w,) px"""
    rows: Array
    """(h,) px"""
    shift: Array
    """(h, w, 2) px: red's place in the picture less that of blue, for the point that the pixel sees
    in green light; NaN where a channel does not see it.
    """

    @property
    def size(self) -> Array:
        """(h, w) px"""
        return np.asarray(np.linalg.norm(self.shift, axis=-1))

    @property
    def rms(self) -> float:
        """px, over the picture."""
        return float(np.sqrt(np.nanmean(self.size**2)))

    @property
    def largest(self) -> tuple[float, float, float]:
        """The largest size, px, and the pixel x and y of it."""
        row, column = np.unravel_index(np.nanargmax(self.size), self.size.shape)
        return (
            float(self.size[row, column]),
            float(self.columns[column]),
            float(self.rows[row]),
        )


def predict_fringes(
    calibration: Calibration, depths: Sequence[float] = ()
) -> tuple[ColourFringes, ...]:
    """Return the fringes at depths in m, by default those of the nearest, the median and the
    farthest corner; nothing if the cover has no dispersion.
    """
    if not calibration.cover.has_dispersion:
        return ()
    camera = calibration.camera
    columns = np.linspace(0, camera.width - 1, COLUMNS)
    rows = np.linspace(0, camera.height - 1, ROWS)
    pixels = np.stack(np.meshgrid(columns, rows), -1).reshape(-1, 2)
    origins, directions = calibration.rays(pixels)
    wide = calibration.model()[0].lens.wide
    red = channel_calibration(calibration, RED)
    blue = channel_calibration(calibration, BLUE)
    fringes = []
    for depth in dict.fromkeys(depths or _corner_depths(calibration)):
        ahead = depth if wide else (depth - origins[:, 2:]) / directions[:, 2:]
        points = origins + directions * ahead
        shift = red.project(points) - blue.project(points)
        if np.isfinite(shift).any():
            grid = shift.reshape(ROWS, COLUMNS, 2)
            fringes.append(ColourFringes(float(depth), columns, rows, grid))
    return tuple(fringes)


def _corner_depths(calibration: Calibration) -> tuple[float, ...]:
    """Return the distances in m of the nearest, the median and the farthest corner."""
    distance = corners_at(calibration)[:, 2]
    distance = distance[distance > 0]
    if not len(distance):
        return (1.0,)
    near, median, far = np.quantile(distance, (0.0, 0.5, 1.0)).round(3).tolist()
    return near, median, far
