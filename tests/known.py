"""Calibrations that know the truth: what is measured with them errs by the code alone."""

import numpy as np

from calib.calibration import Calibration
from calib.camera import Camera, Intrinsics
from calib.cover import Cover
from calib.optics.relief import Relief
from calib.schema import Number
from tests.scenes import HEIGHT, INTRINSICS, PATCH, WIDTH, Scene

NOTHING = np.zeros((0, 0))


def known(made: Scene, width: int, height: int) -> Calibration:
    """The scene's camera with a picture of another width, and cut to a height about its middle."""
    scale = width / WIDTH
    fx, fy, cx, cy = (number.value * scale for number in (INTRINSICS.fx, INTRINSICS.fy, INTRINSICS.cx, INTRINSICS.cy))
    seen = Intrinsics(Number(fx), Number(fy), Number(cx), Number(cy - (HEIGHT * scale - height) / 2))
    amplitudes = made.values["relief.amplitudes"].numpy()
    rows, columns = amplitudes.shape
    return _calibration(made, Camera(width, height, intrinsics=seen), made.cover, Relief(*PATCH, (rows, columns)), amplitudes)


def lens_alone(made: Scene, width: int, height: int, *numbers: float) -> Calibration:
    """A camera without a cover: fx, fy, cx, cy and OpenCV's distortion coefficients."""
    fx, fy, cx, cy, *lens = map(Number, numbers)
    camera = Camera(width, height, intrinsics=Intrinsics(fx, fy, cx, cy, tuple(lens)))
    return _calibration(made, camera, Cover("none", {}), None, NOTHING)


def _calibration(made: Scene, camera: Camera, cover: Cover, relief: Relief | None, amplitudes: np.ndarray) -> Calibration:
    return Calibration(
        board=made.board,
        camera=camera,
        cover=cover,
        relief=relief,
        amplitudes=amplitudes,
        exact_hit=True,
        views=(),
        poses=np.zeros((0, 6)),
        covariance=NOTHING,
        rejected=(),
        stages=(),
        noise_px=0.1,
        settings={},
        gauge="",
    )
