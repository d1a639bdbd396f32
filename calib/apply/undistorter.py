"""Undistortion for streams: at one depth, or with a depth for every pixel, by maps in the form that
OpenCV runs fastest on.

    undistorter = Undistorter(calibration, depth=0.5)
    for frame in frames:
        straight = undistorter.undistort(frame)

`undistorter.at(depth)` is the same picture at another depth. Pixels that the camera does not see
are 0, and false in `valid`; a point that it does not see is NaN.
"""

from __future__ import annotations

from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.errors import InputError
from calib.io.images import Image as Stored
from calib.undistortion.crop import crop_window
from calib.undistortion.depth_stack import DepthStack, depth_stack
from calib.undistortion.grids import Array, Mask
from calib.undistortion.ray_field import RayField, check_depth
from calib.undistortion.remap import MAX_SIDE, remap
from calib.undistortion.window import Window

NEAR = 0.1
"""m: what in a depth image is nearer counts as unknown, if nothing else is asked for."""
FIXED_POINT = int(cv2.__version__.split(".")[0]) < 5
"""Measured: OpenCV 4 is a tenth faster on CV_16SC2 maps and as exact; OpenCV 5 is as fast or twice
as fast on float maps, and exact.
"""

Image = Stored | NDArray[np.float32]

Depth = float | NDArray[np.floating]
"""m: one for all pixels, or a (height, width) image with the depth of every pixel of the
undistorted picture; 0 and NaN are unknown.
"""


class Undistorter:
    """Shows what a camera behind a cover sees as a bare pinhole camera would."""

    def __init__(
        self,
        calibration: Calibration,
        depth: Depth,
        *,
        crop: float | None = None,
        camera_matrix: Array | None = None,
        size: tuple[int, int] | None = None,
        near: float = NEAR,
        interpolation: int = cv2.INTER_LINEAR,
    ) -> None:
        """
        Args:
            calibration: of the camera.
            depth: m, see Depth.
            crop: as the alpha of cv2.getOptimalNewCameraMatrix: 0 shows only valid pixels, 1
                everything that the camera sees. Without it the picture has the camera's own focal
                length and principal point.
            camera_matrix: (3, 3) of the picture, instead of `crop`.
            size: px, width and height of the picture; by default the camera's.
            near: m, the nearest that depth images reach.
            interpolation: of cv2.remap.
        """
        self.calibration = calibration
        self.field: RayField = calibration.ray_field()
        self.near = near
        self._interpolation = interpolation
        self._depth = depth
        check_depth(near)
        if not np.isfinite(near):
            raise InputError(
                "near is not finite: write the nearest distance that depth images reach, such as"
                " 0.1."
            )
        if not _is_image(depth):
            check_depth(float(depth))
        size = size or (self.field.width, self.field.height)
        if min(size) < 2:
            raise InputError(
                f"a picture of {size[0]}x{size[1]} px shows nothing: write a width and height of 2"
                " px or more."
            )
        if crop is not None and camera_matrix is not None:
            raise InputError(
                "crop and camera_matrix both say what the picture shows: give one of them."
            )
        self.window = self._window(crop, camera_matrix, size)
        self._stack: DepthStack | None = None
        self._show(depth)

    @property
    def depth(self) -> Depth:
        return self._depth

    @property
    def size(self) -> tuple[int, int]:
        """px, width and height of the undistorted picture."""
        return self.window.width, self.window.height

    @property
    def camera_matrix(self) -> Array:
        """(3, 3) of the undistorted picture: it has no other distortion."""
        (fx, fy), (cx, cy) = self._pinhole()
        (left, top), (wide, high) = self.window.corner, self.window.zoom
        return np.array(
            [[fx / wide, 0, (cx - left) / wide], [0, fy / high, (cy - top) / high], [0, 0, 1]]
        )

    def at(self, depth: Depth) -> Undistorter:
        """The same picture at another depth, or with another depth image: what does not depend on
        depth is shared.
        """
        if not _is_image(depth):
            check_depth(float(depth))
        other = object.__new__(Undistorter)
        other.__dict__.update(self.__dict__)
        other._show(depth)
        self._stack = other._stack
        return other

    def undistort(self, image: Image, into: Image | None = None) -> Image:
        """A picture of the camera, straightened.

        Args:
            image: (H, W) or (H, W, 3), uint8, uint16 or float32, of the calibrated size.
            into: where to write the result, of `size` and the image's type: saves making room for
                it.
        """
        field = self.field
        if image.shape[:2] != (field.height, field.width):
            raise InputError(
                f"the picture is {image.shape[1]}x{image.shape[0]} px where the calibration is for"
                f" {field.width}x{field.height}: give pictures of the calibrated camera mode."
            )
        if into is not None and (
            into.shape != (*self.valid.shape, *image.shape[2:]) or into.dtype != image.dtype
        ):
            raise InputError(
                f"the result does not fit into an array of {into.dtype} of shape {into.shape}: make"
                " it like the picture."
            )
        linear = self._interpolation == cv2.INTER_LINEAR
        border = cv2.BORDER_CONSTANT if linear else cv2.BORDER_REPLICATE
        straight = remap(image, *self.maps, self._interpolation, border, into)
        if not linear and self._holes:
            straight[~self.valid] = 0
        return cast(Image, straight)

    def undistort_points(self, pixels: Array, depth: float | Array | None = None) -> Array:
        """(N, 2) px of the camera to (N, 2) px of the undistorted picture; NaN where the camera
        does not see.

        Args:
            pixels: (N, 2)
            depth: m, one for all or (N,); the undistorter's own if it has one for all.
        """
        metres = self._metres(depth, pixels)
        undistorted = self.field.undistort_pixels(pixels, metres)
        seen = self.field.sees(pixels[:, 0], pixels[:, 1], metres) & (metres > 0)
        return np.where(
            seen[:, None], (undistorted - self.window.corner) / self.window.zoom, np.nan
        )

    def distort_points(self, pixels: Array, depth: float | Array | None = None) -> Array:
        """(N, 2) px of the undistorted picture to the (N, 2) px of the camera that see them; NaN
        where none does. Arguments as above.
        """
        metres = self._metres(depth, pixels)
        there = metres > 0
        plane = pixels * np.array(self.window.zoom) + self.window.corner
        distorted, seen = self.field.distort_pixels(plane, np.where(there, metres, np.inf))
        return np.where((seen & there)[:, None], distorted, np.nan)

    def project(self, points: Array) -> Array:
        """(N, 3) m in the camera frame to the (N, 2) px of the camera that see them; NaN where none
        does.
        """
        return self.calibration.project(points)

    def rays(self, pixels: Array) -> tuple[Array, Array]:
        """(N, 2) px of the camera to (N, 3) m where their rays leave the cover and (N, 3) unit
        where these go; NaN where none does.
        """
        return self.calibration.rays(pixels)

    def _show(self, depth: Depth) -> None:
        self._depth = depth
        if not _is_image(depth):
            made = self.field.map_at(float(depth), self.window)
            x, y, self.valid = made.x, made.y, made.valid
        else:
            image = np.asarray(depth)
            if image.shape != (self.window.height, self.window.width) or image.dtype.kind != "f":
                raise InputError(
                    f"the depth image is {image.dtype} of shape {image.shape}: give floating-point"
                    " metres for each undistorted pixel, of shape"
                    f" {(self.window.height, self.window.width)}."
                )
            self._stack = self._stack or depth_stack(self.field, self.window, self.near)
            x, y, self.valid = self._stack.map_at(image)
        self._holes = not self.valid.all()
        self.maps = _fast(x, y, self.valid, self.field)

    def _window(
        self, crop: float | None, camera_matrix: Array | None, size: tuple[int, int]
    ) -> Window:
        if crop is not None:
            depths = (
                (self.near, np.inf)
                if _is_image(self._depth)
                else (float(cast(float, self._depth)),)
            )
            return crop_window(self.field, depths, crop, size)
        if camera_matrix is None:
            return Window(*size)
        (fx, fy), (cx, cy) = self._pinhole()
        matrix = np.asarray(camera_matrix, dtype=np.float64)
        if matrix.shape != (3, 3) or not (
            matrix[0, 0] > 0 and matrix[1, 1] > 0 and np.isfinite(matrix).all()
        ):
            raise InputError(
                "the camera matrix is not [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with fx and fy"
                " above 0."
            )
        zoom = fx / float(matrix[0, 0]), fy / float(matrix[1, 1])
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

    def _metres(self, depth: float | Array | None, pixels: Array) -> Array:
        if depth is None:
            if _is_image(self._depth):
                raise InputError("each pixel has its own depth: say at which depth the points are.")
            depth = float(cast(float, self._depth))
        return np.broadcast_to(np.asarray(depth, dtype=np.float64), len(pixels))


def _is_image(depth: Depth) -> bool:
    return np.ndim(depth) != 0


def _fast(
    x: NDArray[np.float32], y: NDArray[np.float32], valid: Mask, field: RayField
) -> tuple[Any, Any]:
    """Two maps for cv2.remap.

    Valid pixels are kept on the image, so that a constant border fills what is not valid and
    nothing else.
    """
    for axis, size in ((x, field.width), (y, field.height)):
        np.clip(axis, 0, size - 1, out=axis)
        np.copyto(axis, -1, where=~valid)
    small = max(*x.shape, field.width, field.height) <= MAX_SIDE  # 16 bits hold no more
    return cv2.convertMaps(x, y, cv2.CV_16SC2) if FIXED_POINT and small else (x, y)
