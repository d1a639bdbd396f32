"""Fit mrcal's splined lens (LENSMODEL_SPLINED_STEREOGRAPHIC) to directions with known pixels.

A direction at an angle from the optical axis has stereographic coordinates u of length 2 tan(angle
/ 2). A bicubic B-spline surface over u, with evenly spaced knots, shifts them, and a fixed pinhole
scales them to px. So the control points follow from linear least squares. The knots at the border
stand one spacing beyond the stated field of view.

Source: https://mrcal.secretsauce.net/splined-models.html
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import NdBSpline
from scipy.sparse import csr_array
from scipy.sparse.linalg import spsolve

from calib.export.formats import ExportLens

Array = NDArray[np.float64]

KNOTS_X = 24
"""Knots along x."""
REGULARISATION = 1e-12
"""The weight of a control point's square relative to an observed direction's. It keeps control
points that no pixel sees at 0.
"""


def fit_spline(normalised: Array, pixels: Array, bare: Sequence[float]) -> tuple[ExportLens, Array]:
    """Fit the control points.

    Args:
        normalised: (N, 2) normalised image coordinates, x / z and y / z, of what each pixel sees.
        pixels: (N, 2) px
        bare: fx, fy, cx, cy px and more, of the camera without its cover. The four are kept.

    Returns:
        The lens, whose name states the field of view, and its (4 + coefficients,) parameters: fx,
        fy, cx, cy, then control points in stereographic coordinates, row by row, x and y of each in
        turn.
    """
    u = _stereographic(normalised)
    wide, tall = np.abs(u).max(0)
    degrees = math.ceil(4 * math.degrees(math.atan(wide / 2)) * (1 + 1e-6))
    spacing = 4 * math.tan(math.radians(degrees) / 4) / (KNOTS_X - 3)
    knots_y = math.ceil(2 * tall / spacing * (1 + 1e-6)) + 3
    design = NdBSpline.design_matrix(_y_first(u), _knots(KNOTS_X, knots_y, spacing), 3)
    basis = csr_array(
        (design.data, design.indices, design.indptr), (len(u), knots_y * KNOTS_X)
    )  # scipy drops unused columns at the end
    scale, shift = np.array(bare[:2]), np.array(bare[2:4])
    normal = (basis.T @ basis).tocsc()
    normal.setdiag(normal.diagonal() + REGULARISATION * len(u) / normal.shape[0])
    control = np.asarray(spsolve(normal, basis.T @ ((pixels - shift) / scale - u)))
    name = f"SPLINED_STEREOGRAPHIC_order=3_Nx={KNOTS_X}_Ny={knots_y}_fov_x_deg={degrees}"
    return ExportLens(name, control.size, knots=(KNOTS_X, knots_y, spacing)), np.concatenate(
        [bare[:4], control.ravel()]
    )


def project_spline(lens: ExportLens, parameters: Array, normalised: Array) -> Array:
    """Return (N, 2) px of (N, 2) normalised image coordinates, with the lens and parameters of
    `fit_spline`.

    Beyond the knots, the outermost polynomials continue the surface.
    """
    assert lens.knots
    knots_x, knots_y, _ = lens.knots
    u = _stereographic(normalised)
    shifts = NdBSpline(_knots(*lens.knots), parameters[4:].reshape(knots_y, knots_x, 2), 3)(
        _y_first(u)
    )
    return np.asarray((u + shifts) * parameters[:2] + parameters[2:4])


def _stereographic(normalised: Array) -> Array:
    """Return (N, 2) u of length 2 tan(angle / 2), in the direction of the (N, 2) normalised image
    coordinates.
    """
    return np.asarray(2 * normalised / (1 + np.sqrt(1 + (normalised**2).sum(-1, keepdims=True))))


def _y_first(u: Array) -> Array:
    """Return (N, 2) y and x, contiguous as scipy expects them. The control points come in rows, so
    y is their first axis.
    """
    return np.ascontiguousarray(u[:, ::-1])


def _knots(count_x: int, count_y: int, spacing: float) -> tuple[Array, Array]:
    """Return (count_y + 4,) and (count_x + 4,) knots along y and x.

    The B-spline of each control point is centred on its own knot of mrcal's. scipy's knots start
    with a B-spline's support, so they reach two spacings further.
    """
    return _axis_knots(count_y, spacing), _axis_knots(count_x, spacing)


def _axis_knots(count: int, spacing: float) -> Array:
    return spacing * (np.arange(-2, count + 2, dtype=np.float64) - (count - 1) / 2)
