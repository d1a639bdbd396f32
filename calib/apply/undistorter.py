"""Undistortion for streams, at one depth or with a depth for every pixel. The maps have the form
with which OpenCV is fastest.

    undistorter = Undistorter(calibration, depth=0.5)
    for frame in frames:
        straight = undistorter.undistort(frame)

`undistorter.at(depth)` returns an undistorter for the same picture at another depth. Pixels that
the camera does not see are 0, and false in `valid`. Points that it does not see are NaN.
"""

from __future__ import annotations

import math
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration, CalibrationSource
from calib.errors import InputError, brief
from calib.fitting.corner_range import corners_at
from calib.io.array_arguments import (
    FARTHEST_M,
    FARTHEST_PX,
    as_array,
    numbers,
    on_finite_rows,
    one_of,
    picture,
    pixel_rows,
    row_numbers,
)
from calib.io.images import Image as Stored
from calib.io.numerals import real_number
from calib.undistortion.crop import crop_window
from calib.undistortion.depth_stack import DepthStack, depth_stack
from calib.undistortion.grids import Array, Mask
from calib.undistortion.inverse import SPACING
from calib.undistortion.ray_field import MIN_DEPTH, RayField, check_depth
from calib.undistortion.remap import MAX_SIDE, remap
from calib.undistortion.window import Window

NEAR = 0.1
"""m: by default, nearer depths of a depth image count as unknown."""
MAX_NODES = 300_000
"""The largest number of nodes of the inverse, which are SPACING px of the bare camera apart, over
the view of a camera matrix: solving for these takes seconds. A view nine times as wide as that of a
camera of a million px has fewer.
"""
MAX_ENLARGEMENT = 4
"""A view of up to this many times the camera's picture is allowed whatever its number of nodes."""
INTERPOLATIONS = (
    cv2.INTER_NEAREST,
    cv2.INTER_LINEAR,
    cv2.INTER_CUBIC,
    cv2.INTER_AREA,
    cv2.INTER_LANCZOS4,
)
FIXED_POINT = int(cv2.__version__.split(".")[0]) < 5
"""OpenCV 4 was measured to be a tenth faster with CV_16SC2 maps, and equally exact. OpenCV 5 is
equally fast or twice as fast with float maps, and exact.
"""

Image = Stored | NDArray[np.float32]

Depth = float | NDArray[np.floating]
"""m: one depth for all pixels, or a (height, width) image with the depth of every pixel of the
undistorted picture; 0 and NaN are unknown.
"""


class Undistorter:
    """Converts pictures and points of a camera behind a cover to those of a bare pinhole camera."""

    def __init__(
        self,
        calibration: CalibrationSource,
        depth: Depth | None = None,
        *,
        crop: float | None = None,
        camera_matrix: Array | None = None,
        size: tuple[int, int] | None = None,
        near: float = NEAR,
        interpolation: int = cv2.INTER_LINEAR,
    ) -> None:
        """
        Args:
            calibration: the camera's calibration, or the path of its file or folder.
            depth: m, see Depth; by default the median depth of the calibration's corners.
            crop: the alpha of cv2.getOptimalNewCameraMatrix: 0 shows only valid pixels, 1
                everything that the camera sees. Without it, the picture has the camera's focal
                length and principal point.
            camera_matrix: (3, 3) camera matrix of the picture, instead of `crop`.
            size: px, width and height of the picture; by default the camera's.
            near: m, the nearest distance that depth images reach.
            interpolation: the flag of cv2.remap.
        """
        calibration = Calibration.of(calibration)
        self.calibration = calibration
        depth = _median_depth(calibration) if depth is None else depth
        self.field: RayField = calibration.ray_field()
        self._interpolation = one_of(interpolation, INTERPOLATIONS, "interpolation")
        self.near = near = real_number(near, "near")
        check_depth(near)
        if not np.isfinite(near):
            raise InputError(
                "near is not finite: write the nearest distance that depth images reach, such as"
                " 0.1."
            )
        size = (self.field.width, self.field.height) if size is None else _check_size(size)
        if min(size) < 2:
            raise InputError(
                f"a picture of {size[0]}x{size[1]} px shows nothing: write a width and height of 2"
                " px or more."
            )
        if crop is not None and camera_matrix is not None:
            raise InputError(
                "crop and camera_matrix both say what the picture shows: give one of them."
            )
        self._depth = depth if _is_image(depth) else _check_metres(depth)
        self.window = self._make_window(crop, camera_matrix, size)
        self._stack: DepthStack | None = None
        self._set_depth(depth)

    @property
    def depth(self) -> Depth:
        """The depth, m, as it was given."""
        return self._depth

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the undistorted picture, px."""
        return self.window.width, self.window.height

    @property
    def camera_matrix(self) -> Array:
        """The (3, 3) camera matrix of the undistorted picture, which has no distortion."""
        (fx, fy), (cx, cy) = self._pinhole()
        x_min, y_min = self.window.corner
        zoom_x, zoom_y = self.window.zoom
        return np.array(
            [
                [fx / zoom_x, 0, (cx - x_min) / zoom_x],
                [0, fy / zoom_y, (cy - y_min) / zoom_y],
                [0, 0, 1],
            ]
        )

    def at(self, depth: Depth) -> Undistorter:
        """Return an undistorter for the same picture at another depth, or with another depth image.
        The two share everything that does not depend on depth.
        """
        copy = object.__new__(type(self))
        copy.__dict__.update(self.__dict__)
        copy._set_depth(depth)
        self._stack = copy._stack
        return copy

    def undistort(self, image: Image, into: Image | None = None) -> Image:
        """Return the undistorted picture of a picture of the camera.

        Args:
            image: (H, W) or (H, W, 3), uint8, uint16 or float32, of the calibrated size.
            into: an array for the result, of `size` and the image's type. It saves the time to
                allocate one.
        """
        pixels = picture(image, self.field.width, self.field.height)
        if into is not None and not (
            isinstance(into, np.ndarray)
            and into.shape == (*self.valid.shape, *pixels.shape[2:])
            and into.dtype == pixels.dtype
            and into.flags.c_contiguous
            and into.flags.writeable
        ):
            raise InputError(
                "the result does not fit into the array that is given for it: give one of"
                f" {pixels.dtype} of shape {(*self.valid.shape, *pixels.shape[2:])}, in one piece."
            )
        linear = self._interpolation == cv2.INTER_LINEAR
        border = cv2.BORDER_CONSTANT if linear else cv2.BORDER_REPLICATE
        straight = remap(pixels, *self.maps, self._interpolation, border, into)
        if not linear and self._holes:
            straight[~self.valid] = 0
        return cast(Image, straight)

    def undistort_points(self, pixels: Array, depth: float | Array | None = None) -> Array:
        """Return the (N, 2) px of the undistorted picture for (N, 2) px of the camera; NaN where
        the camera does not see.

        Args:
            pixels: (N, 2)
            depth: m, one for all or (N,); by default that of the undistorter, if it is one for all.
        """
        rows = self._pixels_with_inverse_depth(pixels, depth)

        def undistorted(rows: Array) -> tuple[Array]:
            at, metres = rows[:, :2], 1 / rows[:, 2]
            visible = self.field.sees(at[:, 0], at[:, 1], metres)
            plane = self.field.undistort_pixels(at, metres)
            shown = (plane - self.window.corner) / self.window.zoom
            return (np.where(visible[:, None], shown, np.nan),)

        with np.errstate(divide="ignore"):  # a depth may be infinite
            return on_finite_rows(undistorted, rows, 2)[0]

    def distort_points(self, pixels: Array, depth: float | Array | None = None) -> Array:
        """Return the (N, 2) px of the camera that see (N, 2) px of the undistorted picture; NaN
        where no pixel does. The arguments are those of `undistort_points`.
        """
        rows = self._pixels_with_inverse_depth(pixels, depth)

        def distorted(rows: Array) -> tuple[Array]:
            plane = rows[:, :2] * np.array(self.window.zoom) + self.window.corner
            distorted_pixels, visible = self.field.distort_pixels(plane, 1 / rows[:, 2])
            return (np.where(visible[:, None], distorted_pixels, np.nan),)

        with np.errstate(divide="ignore"):
            return on_finite_rows(distorted, rows, 2)[0]

    def project(self, points: Array) -> Array:
        """Return the (N, 2) px of the camera that see (N, 3) m points in the camera frame; NaN
        where no pixel does.
        """
        return self.calibration.project(points)

    def rays(self, pixels: Array) -> tuple[Array, Array]:
        """Return, for (N, 2) px of the camera, the (N, 3) m points where their rays leave the
        cover, and the rays' (N, 3) unit directions; NaN where no ray leaves the cover.
        """
        return self.calibration.rays(pixels)

    def _set_depth(self, depth: Depth) -> None:
        """Set the maps, and the mask of valid pixels, for a depth."""
        if not _is_image(depth):
            self._depth = metres = _check_metres(depth)
            depth_map = self.field.map_at(metres, self.window)
            x, y, self.valid = depth_map.x, depth_map.y, depth_map.valid
        else:
            self._depth = depth
            image = as_array(depth, "the depth image")
            if image.shape != (self.window.height, self.window.width) or image.dtype.kind != "f":
                raise InputError(
                    f"the depth image is {image.dtype} of shape {image.shape}: give floating-point"
                    " metres for each undistorted pixel, of shape"
                    f" {(self.window.height, self.window.width)}."
                )
            self._stack = self._stack or depth_stack(self.field, self.window, self.near)
            with np.errstate(over="ignore"):  # of a depth that is as good as infinite
                x, y, self.valid = self._stack.map_at(image.astype(np.float32, order="C"))
        self._holes = not self.valid.all()
        self.maps = _fast_maps(x, y, self.valid, self.field)

    def _make_window(
        self, crop: float | None, camera_matrix: Array | None, size: tuple[int, int]
    ) -> Window:
        if crop is not None:
            depths = (
                (self.near, np.inf)
                if _is_image(self._depth)
                else (float(cast(float, self._depth)),)
            )
            return crop_window(self.field, depths, real_number(crop, "crop"), size)
        if camera_matrix is None:
            return Window(*size)
        (fx, fy), (cx, cy) = self._pinhole()
        matrix = numbers(camera_matrix, (3, 3), "camera_matrix")
        if not (matrix[0, 0] > 0 and matrix[1, 1] > 0 and (np.abs(matrix[:2]) < FARTHEST_PX).all()):
            raise InputError(
                "the camera matrix is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx and fy"
                " above 0."
            )
        zoom = fx / float(matrix[0, 0]), fy / float(matrix[1, 1])
        shown = math.prod(size) * zoom[0] * zoom[1]  # px of the bare camera
        largest = max(
            MAX_NODES * SPACING**2, MAX_ENLARGEMENT * self.field.width * self.field.height
        )
        if shown > largest:
            smallest_focal = (fx * fy * math.prod(size) / largest) ** 0.5
            raise InputError(
                f"the camera matrix shows far more than the camera sees: give focal lengths of"
                f" {math.ceil(smallest_focal)} px or more for a picture of {size[0]}x{size[1]} px."
            )
        return Window(
            *size, (cx - float(matrix[0, 2]) * zoom[0], cy - float(matrix[1, 2]) * zoom[1]), zoom
        )

    def _pinhole(self) -> tuple[tuple[float, float], tuple[float, float]]:
        intrinsics = self.calibration.camera.intrinsics
        assert intrinsics
        return (intrinsics.fx.value, intrinsics.fy.value), (
            intrinsics.cx.value,
            intrinsics.cy.value,
        )

    def _pixels_with_inverse_depth(self, pixels: Array, depth: float | Array | None) -> Array:
        """Return (N, 3): px, px, and 1 / depth; NaN for a depth that is not in front of the
        camera.
        """
        if depth is None:
            if _is_image(self._depth):
                raise InputError("each pixel has its own depth: say at which depth the points are.")
            depth = cast(float, self._depth)
        at = pixel_rows(pixels)
        metres = row_numbers(depth, len(at), "depth")
        ahead = metres >= MIN_DEPTH
        near = 1 / np.where(ahead, metres, 1.0)
        near[metres > FARTHEST_M] = 0.0
        return np.column_stack([at, np.where(ahead, near, np.nan)])


def _median_depth(calibration: Calibration) -> float:
    """Return the median distance of the calibration's corners, m."""
    corners = corners_at(calibration)
    if not len(corners):
        raise InputError("the calibration has no corners to take a depth from: give depth, in m.")
    return float(np.median(corners[:, 2]))


def _is_image(depth: Depth) -> bool:
    try:
        return np.ndim(depth) != 0
    except ValueError:  # of rows of different lengths
        return True


def _check_metres(depth: Depth) -> float:
    metres = real_number(depth, "depth")
    check_depth(metres)
    return metres


def _check_size(size: tuple[int, int]) -> tuple[int, int]:
    width, height = numbers(size, (2,), "size").tolist()
    if not (width % 1 == height % 1 == 0 and max(width, height) < FARTHEST_PX):
        raise InputError(f"size is {brief(repr(size))}: give width and height in whole px.")
    return int(width), int(height)


def _fast_maps(
    x: NDArray[np.float32], y: NDArray[np.float32], valid: Mask, field: RayField
) -> tuple[Any, Any]:
    """Return two maps for cv2.remap.

    Valid pixels are clipped to the image, so that a constant border fills exactly the pixels that
    are not valid.
    """
    for axis, size in ((x, field.width), (y, field.height)):
        np.clip(axis, 0, size - 1, out=axis)
        np.copyto(axis, -1, where=~valid)
    small = max(*x.shape, field.width, field.height) <= MAX_SIDE  # 16 bits hold no more
    return cv2.convertMaps(x, y, cv2.CV_16SC2) if FIXED_POINT and small else (x, y)
