"""The view of a straight stream: the depth at which it is straight, its crop and its scale."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np

from calib.apply.undistorter import NEAR, Depth, Undistorter
from calib.calibration import Calibration
from calib.errors import InputError, brief
from calib.io.numerals import real_number

MIN_SCALE = 0.05
MAX_SCALE = 4.0
"""A picture that is larger than this shows nothing more of the camera's."""


@dataclass(frozen=True, slots=True)
class StreamView:
    """The numbers that a person may change while a stream runs. InputError if one is impossible."""

    depth: float | None
    """m, the distance of the plane whose picture is straight; may be infinite. Of a stream with a
    depth image: the depth of the pixels that it leaves unknown, which are black if this is None.
    """
    crop: float | None = None
    """The alpha of cv2.getOptimalNewCameraMatrix: 0 shows only valid pixels, 1 everything that the
    camera sees. None: the picture has the camera's focal length.
    """
    scale: float = 1.0
    """The size of the picture over the camera's."""

    def __post_init__(self) -> None:
        if self.depth is not None and not self.depth > 0:
            raise InputError(f"depth is {self.depth:g}: write metres above 0, such as 0.5.")
        if self.crop is not None and not 0 <= self.crop <= 1:
            raise InputError(
                f"crop is {self.crop:g}: write 0 for valid pixels only, 1 for all that the camera"
                " sees, or a number between."
            )
        if not MIN_SCALE <= self.scale <= MAX_SCALE:
            raise InputError(
                f"scale is {self.scale:g}: write a number from {MIN_SCALE:g} to {MAX_SCALE:g}, such"
                " as 0.5."
            )

    def changed(self, values: Mapping[str, object]) -> "StreamView":
        """Return the view with some numbers replaced; InputError says which of them is wrong.

        Args:
            values: by their names, depth, crop and scale. A depth and a crop may be None.
        """
        names = asdict(self).keys()
        if unknown := [name for name in values if name not in names]:
            raise InputError(f"{brief(unknown[0])} is not of a view: write {', '.join(names)}.")
        numbers = {
            name: None if name != "scale" and value is None else real_number(value, name)
            for name, value in values.items()
        }
        return replace(self, **numbers)  # type: ignore[arg-type]

    def size(self, calibration: Calibration) -> tuple[int, int]:
        """Return the width and height of the picture, px. They are even, because video formats
        share one colour between two pixels.
        """
        camera = calibration.camera
        width = max(2, 2 * round(camera.width * self.scale / 2))
        height = max(2, 2 * round(camera.height * self.scale / 2))
        return width, height

    def undistorter(
        self, calibration: Calibration, depth: Depth | None = None, near: float = NEAR
    ) -> Undistorter:
        """Return the undistorter that makes the picture; InputError if no ray reaches the depth.

        Args:
            depth: m, a depth image for the picture; None: the depth of the view.
            near: m, the smallest depth of depth images.
        """
        size = self.size(calibration)
        depth = self.depth if depth is None else depth
        if self.crop is not None:
            return Undistorter(calibration, depth, crop=self.crop, size=size, near=near)
        k = calibration.camera.intrinsics
        assert k
        x_scale = size[0] / calibration.camera.width
        y_scale = size[1] / calibration.camera.height
        matrix = np.array(
            [
                [k.fx.value * x_scale, 0, (k.cx.value + 0.5) * x_scale - 0.5],
                [0, k.fy.value * y_scale, (k.cy.value + 0.5) * y_scale - 0.5],
                [0, 0, 1],
            ]
        )
        return Undistorter(calibration, depth, camera_matrix=matrix, size=size, near=near)
