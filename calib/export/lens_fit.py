"""A pinhole with OpenCV's lens, or its fisheye, fitted to directions whose pixels are known.

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

COUNT = 16
"""fx, fy, cx, cy and twelve coefficients."""
SMALL, LONGER, PRISM, RATIONAL, ALL = (
    (*range(8),),
    (*range(9),),
    (*range(9), *range(12, 16)),
    (*range(12),),
    (*range(16),),
)
"""Which of the sixteen a model leaves free."""
LADDER = {
    4: (SMALL,),
    5: (SMALL, LONGER),
    8: (SMALL, LONGER, RATIONAL),
    12: (SMALL, LONGER, PRISM, RATIONAL, ALL),
}
"""By number of coefficients: the models that are tried, each started from the one before.

Many coefficients at once stop in poor places.
"""
WORTH = 0.02
"""Of the misfit: a model of more free parameters must leave less by more than this."""
POLE = 0.1
"""The least denominator of a rational lens within the image: smaller, a zero and a pole nearly
cancel, and between the fitted pixels they do not.
"""


def project(parameters: Array, tangents: Array, fisheye: bool) -> tuple[Array, Array]:
    """(N, 2) px of (N, 2) slopes x / z and y / z by (4 + coefficients,) parameters, and the (2N, 4
    + coefficients) derivatives.
    """
    fx, fy, cx, cy = parameters[:4]
    matrix, still = np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]]), np.zeros(3)
    points = np.column_stack([tangents, np.ones(len(tangents))])
    if fisheye:
        pixels, derivatives = cv2.fisheye.projectPoints(
            points[:, None], still, still, matrix, parameters[4:].copy()
        )
        first = 0
    else:
        pixels, derivatives = cv2.projectPoints(points, still, still, matrix, parameters[4:].copy())
        first = 6  # after the pose's
    chosen = derivatives[:, first : first + len(parameters)]
    return np.asarray(pixels, np.float64).reshape(-1, 2), np.asarray(chosen, np.float64)


def as_intrinsics(parameters: Sequence[float], fisheye: bool) -> Intrinsics:
    """The same as a session describes it, of (4 + coefficients,) parameters."""
    fx, fy, cx, cy, *lens = map(Number, parameters)
    return Intrinsics(fx, fy, cx, cy, tuple(lens), model=FISHEYE if fisheye else OPENCV)


def fit_lens(tangents: Array, pixels: Array, bare: Sequence[float], lens: ExportLens) -> Array:
    """The (4 + coefficients,) parameters with the least squared misfit; coefficients that are not
    worth having stay 0.

    Args:
        tangents: (N, 2) x / z and y / z of what each pixel sees.
        pixels: (N, 2) px
        bare: fx, fy, cx, cy and coefficients of the camera without its cover, where the search
            starts; none of another model's.
    """
    if lens.fisheye:
        return _least(
            tangents, pixels, np.pad(bare, (0, 8 - len(bare))), tuple(range(8)), fisheye=True
        )[0]
    found = np.pad(bare[:4], (0, COUNT - 4))
    tried = []
    for free in LADDER[lens.coefficients]:
        found, rms = _least(tangents, pixels, found, free)
        tried.append((found, rms))
    own = range(4, min(len(bare), 4 + lens.coefficients))
    if len(own) == len(bare) - 4 > 0:
        tried.append(
            _least(
                tangents,
                pixels,
                np.pad(bare, (0, max(0, COUNT - len(bare)))),
                LADDER[lens.coefficients][-1],
            )
        )
    sound = [
        (parameters, rms) for parameters, rms in tried if _denominator(parameters, tangents) > POLE
    ] or tried[:1]
    best = simplest_model({place: rms for place, (_, rms) in enumerate(sound)}, WORTH)
    return sound[best][0][: 4 + lens.coefficients]


def _least(
    tangents: Array, pixels: Array, start: Array, free: Sequence[int], *, fisheye: bool = False
) -> tuple[Array, float]:
    """The parameters with those that are free fitted, and the root mean square misfit, px."""
    chosen = list(free)

    def whole(some: Array) -> Array:
        parameters = start.copy()
        parameters[chosen] = some
        return parameters

    def off(some: Array) -> Array:
        return (project(whole(some), tangents, fisheye)[0] - pixels).ravel()

    def derivatives(some: Array) -> Array:
        return project(whole(some), tangents, fisheye)[1][:, chosen]

    found = least_squares(
        off,
        start[chosen],
        derivatives,
        x_scale="jac",
        xtol=1e-12,
        ftol=1e-12,
        gtol=1e-12,
        max_nfev=200,
    )
    return whole(found.x), float(np.sqrt(2 * found.cost / len(pixels)))


def _denominator(parameters: Array, tangents: Array) -> float:
    """The least within the image."""
    r2 = np.linspace(0, (tangents**2).sum(-1).max(), 1000)
    return float((1 + r2 * (parameters[9] + r2 * (parameters[10] + r2 * parameters[11]))).min())
