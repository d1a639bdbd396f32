"""Fit a pinhole with OpenCV's lens, or its fisheye, to directions with known pixels.

OpenCV itself projects.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calib.estimation.model_choice import simplest_model
from calib.export.formats import ExportLens
from calib.session.camera import Intrinsics
from calib.session.lens import FISHEYE, OPENCV
from calib.session.schema import Number

Array = NDArray[np.float64]

PARAMETER_COUNT = 16
"""fx, fy, cx, cy and twelve coefficients."""
# The parameters that each model leaves free, as indices into the sixteen:
FOUR_COEFFICIENTS = (*range(8),)
FIVE_COEFFICIENTS = (*range(9),)
PRISM = (*range(9), *range(12, 16))
RATIONAL = (*range(12),)
ALL = (*range(16),)
MODEL_SEQUENCES = {
    4: (FOUR_COEFFICIENTS,),
    5: (FOUR_COEFFICIENTS, FIVE_COEFFICIENTS),
    8: (FOUR_COEFFICIENTS, FIVE_COEFFICIENTS, RATIONAL),
    12: (FOUR_COEFFICIENTS, FIVE_COEFFICIENTS, PRISM, RATIONAL, ALL),
}
"""The models that are tried for a number of coefficients, each started from the previous one.

A fit of many coefficients at once ends in poor local minima.
"""
MIN_IMPROVEMENT = 0.02
"""Part of the misfit by which a model with more free parameters must lower it."""
MIN_DENOMINATOR = 0.1
"""The smallest denominator of a rational lens within the image. With a smaller one, a zero and a
pole nearly cancel, and between the fitted pixels they do not.
"""


def project_slopes(parameters: Array, tangents: Array, fisheye: bool) -> tuple[Array, Array]:
    """Return (N, 2) px of (N, 2) slopes x / z and y / z with (4 + coefficients,) parameters, and
    the (2N, 4 + coefficients) derivatives.
    """
    fx, fy, cx, cy = parameters[:4]
    matrix = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])
    no_motion = np.zeros(3)
    points = np.column_stack([tangents, np.ones(len(tangents))])
    if fisheye:
        pixels, derivatives = cv2.fisheye.projectPoints(
            points[:, None], no_motion, no_motion, matrix, parameters[4:].copy()
        )
        first = 0
    else:
        pixels, derivatives = cv2.projectPoints(
            points, no_motion, no_motion, matrix, parameters[4:].copy()
        )
        first = 6  # the pose's derivatives come first
    chosen = derivatives[:, first : first + len(parameters)]
    return np.asarray(pixels, np.float64).reshape(-1, 2), np.asarray(chosen, np.float64)


def to_intrinsics(parameters: Sequence[float], fisheye: bool) -> Intrinsics:
    """Return (4 + coefficients,) parameters as a session describes them."""
    fx, fy, cx, cy, *lens = map(Number, parameters)
    return Intrinsics(fx, fy, cx, cy, tuple(lens), model=FISHEYE if fisheye else OPENCV)


def fit_export_lens(
    tangents: Array, pixels: Array, bare: Sequence[float], lens: ExportLens
) -> Array:
    """Return the (4 + coefficients,) parameters with the least squared misfit. Coefficients that
    hardly improve it stay 0.

    Args:
        tangents: (N, 2) x / z and y / z of what each pixel sees.
        pixels: (N, 2) px
        bare: fx, fy, cx, cy and coefficients of the camera without its cover, where the search
            starts; no coefficients of another model.
        lens: the model.
    """
    if lens.fisheye:
        start = np.pad(bare, (0, 8 - len(bare)))
        return _fit_free(tangents, pixels, start, tuple(range(8)), fisheye=True)[0]
    models = MODEL_SEQUENCES[lens.coefficients]
    parameters = np.pad(bare[:4], (0, PARAMETER_COUNT - 4))
    candidates = []
    for free in models:
        parameters, rms = _fit_free(tangents, pixels, parameters, free)
        candidates.append((parameters, rms))
    if 4 < len(bare) <= 4 + lens.coefficients:
        start = np.pad(bare, (0, max(0, PARAMETER_COUNT - len(bare))))
        candidates.append(_fit_free(tangents, pixels, start, models[-1]))
    sound = [
        (parameters, rms)
        for parameters, rms in candidates
        if _denominator(parameters, tangents) > MIN_DENOMINATOR
    ] or candidates[:1]
    best = simplest_model({index: rms for index, (_, rms) in enumerate(sound)}, MIN_IMPROVEMENT)
    return sound[best][0][: 4 + lens.coefficients]


def _fit_free(
    tangents: Array, pixels: Array, start: Array, free: Sequence[int], *, fisheye: bool = False
) -> tuple[Array, float]:
    """Return the parameters after a fit of the free ones, and the root mean square misfit, px."""
    index = list(free)

    def complete(values: Array) -> Array:
        parameters = start.copy()
        parameters[index] = values
        return parameters

    def residuals(values: Array) -> Array:
        return (project_slopes(complete(values), tangents, fisheye)[0] - pixels).ravel()

    def derivatives(values: Array) -> Array:
        return project_slopes(complete(values), tangents, fisheye)[1][:, index]

    solution = least_squares(
        residuals,
        start[index],
        derivatives,
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
        max_nfev=200,
    )
    return complete(solution.x), float(np.sqrt(2 * solution.cost / len(pixels)))


def _denominator(parameters: Array, tangents: Array) -> float:
    """Return the smallest denominator of the rational lens within the image."""
    r2 = np.linspace(0, (tangents**2).sum(-1).max(), 1000)
    return float((1 + r2 * (parameters[9] + r2 * (parameters[10] + r2 * parameters[11]))).min())
