"""OpenCV's lens fitted through its rays, with priors, where cv2.calibrateCamera does not do.

It differentiates a sensor's tilt numerically in each step, and its steps are many. And it has no
priors: a rational lens ends with a pole inside the picture, beside a zero that nearly cancels it.
"""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

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
from calib.optics.params import Values
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.freeing import free_own_intrinsics
from calib.session.lens import NAMES, OPENCV, RADIAL_POWERS
from calib.session.parameter_names import CAMERA
from calib.session.schema import Number
from calib.threads import single_thread

LOOSE_FOCAL, LOOSE_CENTRE = 1.0, 1.0
"""Standard deviations of priors that constrain nothing: of focal lengths and the principal point,
relative to the focal length.
"""

RATIONAL_TERMS = {2: 1.5, 4: 0.75, 6: 0.125}
"""The coefficients of (1 + r^2 / 2)^3, by the power of r."""


def fit_through_rays(
    views: Sequence[View], board: Board, start: OpenCVFit, count: int, focal: float | None = None
) -> OpenCVFit:
    """Return the fit with some number of coefficients, of which the radial ones have a prior
    (`prior_means`).

    Args:
        views: the views of the start.
        board: their board.
        start: a fit with fewer coefficients, or with as many.
        count: the number of coefficients.
        focal: px, the horizontal focal length to hold; the ratio of the two is held as well.

    Raises:
        NotEnoughDataError: no such lens fits these views.
    """
    scale = focal / start.focal if focal else 1.0
    fx, fy = (scale * start.camera.diagonal()[:2]).tolist()
    cx, cy = start.camera[:2, 2].tolist()
    coefficients = np.zeros(count)
    coefficients[: len(start.coefficients)] = start.coefficients
    lens = tuple(map(Number, coefficients.tolist()))
    intrinsics = free_own_intrinsics(
        Intrinsics(Number(fx), Number(fy), Number(cx), Number(cy), lens)
    )
    path, values = pinhole_path(intrinsics)
    names = map(CAMERA.of, NAMES[OPENCV])
    sigmas = {
        name: number.sigma for name, number in zip(names, intrinsics.distortion, strict=False)
    }
    sigmas |= dict.fromkeys(CAMERA.centre, LOOSE_CENTRE * fx)
    if not focal:
        sigmas |= dict.fromkeys(CAMERA.focal, LOOSE_FOCAL * fx)
    model = CameraModel(path, prior_means(values), Priors(sigmas))
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
    camera, fitted = opencv_intrinsics(joint.values)
    return OpenCVFit(
        camera=camera,
        coefficients=fitted,
        per_view=residual.view_errors(observations),
        poses=joint.poses.numpy(),
        rms=residual.rms_px,
    )


def prior_means(values: Values) -> dict[str, Tensor]:
    """Return the values of a lens with its radial coefficients at the means of their priors, where
    the lens distorts nothing.

    That is zero; for a rational lens, numerator and denominator are (1 + r^2 / 2)^3, with the
    distance r from the axis over that of the picture's corner. At zero, a lens with a pole would
    often be nearer than one without.
    """
    corner = torch.hypot(
        values[CAMERA.cx] / values[CAMERA.fx], values[CAMERA.cy] / values[CAMERA.fy]
    )
    is_rational = CAMERA.of("k4") in values
    means = dict(values)
    for coefficient, power in RADIAL_POWERS.items():
        name = CAMERA.of(coefficient)
        if name in values:
            term = RATIONAL_TERMS[power] if is_rational else 0.0
            means[name] = term / corner**power
    return means
