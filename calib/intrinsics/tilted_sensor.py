"""OpenCV's lens with a tilted sensor, fitted through its rays.

cv2.calibrateCamera differentiates the tilt numerically in each step, and its steps are many.
"""

from collections.abc import Sequence

import numpy as np
import torch

from calib.corners.view import View
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS, Start
from calib.estimation.observations import Observations
from calib.estimation.poses import opencv_intrinsics
from calib.estimation.priors import Priors
from calib.estimation.residuals import residuals
from calib.intrinsics.advice import NoFitError
from calib.intrinsics.opencv_fit import OpenCVFit
from calib.optics.build import pinhole_path
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.lens import NAMES, OPENCV
from calib.session.parameter_names import CAMERA
from calib.session.schema import Number
from calib.threads import single_thread

LOOSE_FOCAL, LOOSE_CENTRE, LOOSE_COEFFICIENT = 1.0, 1.0, 10.0
"""Standard deviations of priors that constrain nothing: of focal lengths and the principal point,
relative to the focal length, and of a coefficient.
"""


def fit_tilted_sensor(
    views: Sequence[View], board: Board, start: OpenCVFit, focal: float | None = None
) -> OpenCVFit:
    """Return the fit with all coefficients, from a fit with some.

    Args:
        views: the views of the start.
        board: their board.
        start: a fit with fewer coefficients, or with as many.
        focal: px, the horizontal focal length to hold; the ratio of the two is held as well.

    Raises:
        NotEnoughDataError: no such lens fits these views.
    """
    count = len(NAMES[OPENCV])
    scale = focal / start.focal if focal else 1.0
    fx, fy = (scale * start.camera.diagonal()[:2]).tolist()
    cx, cy = start.camera[:2, 2].tolist()
    coefficients = np.zeros(count)
    coefficients[: len(start.coefficients)] = start.coefficients
    numbers = tuple(Number(float(value), LOOSE_COEFFICIENT) for value in coefficients)
    path, values = pinhole_path(Intrinsics(Number(fx), Number(fy), Number(cx), Number(cy), numbers))
    sigmas = {CAMERA.of(name): LOOSE_COEFFICIENT for name in NAMES[OPENCV]}
    sigmas |= dict.fromkeys(CAMERA.centre, LOOSE_CENTRE * fx)
    if not focal:
        sigmas |= dict.fromkeys(CAMERA.focal, LOOSE_FOCAL * fx)
    model = CameraModel(path, values, Priors(sigmas))
    observations = Observations.of(views, board)
    with single_thread():
        joint = model.fit(
            observations,
            torch.from_numpy(start.poses),
            Start(values, start.rms / 2**0.5, None),
            ROUNDS,
        )
        if not joint.finite:
            raise NoFitError()
        residual = residuals(path, joint.values, observations, joint.poses)
    camera, lens = opencv_intrinsics(joint.values)
    return OpenCVFit(
        camera=camera,
        coefficients=lens,
        per_view=residual.view_errors(observations),
        poses=joint.poses.numpy(),
        rms=residual.rms_px,
    )
