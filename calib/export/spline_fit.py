"""mrcal's splined lens, fitted to directions whose pixels are known.

A direction's stereographic coordinates u = 2 tan(angle / 2) are shifted by a uniform cubic B-spline surface over u, and scaled by a
fixed pinhole to px. So the control points follow from linear least squares. Knots stand one spacing beyond the stated field of view.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.linalg import spsolve

from calib.export.formats import Lens

Array = NDArray[np.float64]

ACROSS = 24
"""Knots along x."""
HOLD = 1e-12
"""How much a control point's square counts beside an observed direction's: it keeps those that no pixel sees at 0."""


def fit_spline(slopes: Array, pixels: Array, bare: Sequence[float]) -> tuple[Lens, Array]:
    """The lens with its field of view, and its (4 + coefficients,) numbers: fx, fy, cx, cy, then control points, rows of x and y pairs.

    Args:
        slopes: (N, 2) x / z and y / z of what each pixel sees.
        pixels: (N, 2) px
        bare: fx, fy, cx, cy and more, of the camera without its cover. The four are kept.
    """
    u = _stereographic(slopes)
    wide, tall = np.abs(u).max(0)
    degrees = math.ceil(4 * math.degrees(math.atan(wide / 2)) * (1 + 1e-6))
    spacing = 4 * math.tan(math.radians(degrees) / 4) / (ACROSS - 3)
    down = math.ceil(2 * tall / spacing * (1 + 1e-6)) + 3
    basis = _basis(u, ACROSS, down, spacing)
    scale, shift = np.array(bare[:2]), np.array(bare[2:4])
    normal = (basis.T @ basis).tocsc()
    normal.setdiag(normal.diagonal() + HOLD * len(u) / normal.shape[0])
    control = np.asarray(spsolve(normal, basis.T @ ((pixels - shift) / scale - u)))
    name = f"SPLINED_STEREOGRAPHIC_order=3_Nx={ACROSS}_Ny={down}_fov_x_deg={degrees}"
    return Lens(name, control.size, knots=(ACROSS, down, spacing)), np.concatenate([bare[:4], control.ravel()])


def project_spline(lens: Lens, numbers: Array, slopes: Array) -> Array:
    """(N, 2) px of (N, 2) slopes."""
    assert lens.knots
    u = _stereographic(slopes)
    return np.asarray((u + _basis(u, *lens.knots) @ numbers[4:].reshape(-1, 2)) * numbers[:2] + numbers[2:4])


def _stereographic(slopes: Array) -> Array:
    return np.asarray(2 * slopes / (1 + np.sqrt(1 + (slopes**2).sum(-1, keepdims=True))))


def _basis(u: Array, across: int, down: int, spacing: float) -> csr_array:
    """(N, down * across): what each control point contributes at each u."""
    (first_x, weights_x), (first_y, weights_y) = (_taps(u[:, i], count, spacing) for i, count in enumerate((across, down)))
    step = np.arange(4)
    column = (first_y[:, None] + step)[:, :, None] * across + (first_x[:, None] + step)[:, None, :]
    weights = weights_y[:, :, None] * weights_x[:, None, :]
    row = np.broadcast_to(np.arange(len(u))[:, None, None], column.shape)
    return csr_array(coo_array((weights.ravel(), (row.ravel(), column.ravel())), (len(u), across * down)))


def _taps(u: Array, count: int, spacing: float) -> tuple[NDArray[np.intp], Array]:
    """The first of the four knots (N,) that count at each u, and their weights (N, 4); beyond the knots, the last four."""
    at = u / spacing + (count - 1) / 2
    first = np.clip(np.floor(at).astype(np.intp) - 1, 0, count - 4)
    t = at - first - 1
    return first, np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], -1) / 6
