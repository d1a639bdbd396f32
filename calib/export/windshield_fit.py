"""Fit the windshield model of NVIDIA's NCore and of gsplat to known directions: a lens behind two
polynomials that turn a ray.

A unit ray (x, y, z) has phi = asin x and theta = asin y. Their values inside the cover, in front of
the lens, are polynomials in their values outside, with every term up to ORDER, those without theta
first: c0 + c1 phi + ... + (c6 + c7 phi + ...) theta + ... . One pair of polynomials leads inwards,
from points to pixels, the other outwards, from pixels to rays. Each is a least squares fit over a
grid of pixels, so neither is the exact inverse of the other.

Source: BivariateWindshieldModel in ncore/impl/sensors/camera.py of NCore, and the same in
gsplat/cuda/_torch_external_distortion.py.
"""

import numpy as np
import torch
from numpy.typing import NDArray

from calib.export.formats import ExportLens
from calib.export.lens_fit import project_slopes, to_intrinsics
from calib.optics.build import pinhole_path
from calib.optics.exposure import MIDDLE

Array = NDArray[np.float64]

ORDER = 5
"""The highest order that gsplat accepts."""
TERMS = (ORDER + 1) * (ORDER + 2) // 2


def fit_windshield(tangents: Array, pixels: Array, lens: ExportLens, bare: Array) -> Array:
    """Return the (4 + coefficients,) parameters: those of the bare camera, then both polynomials
    inwards and both outwards.

    Args:
        tangents: (N, 2) x / z and y / z of what each pixel sees.
        pixels: (N, 2) px
        lens: the format's lens model.
        bare: fx, fy, cx, cy px and the coefficients of the bare camera's lens.
    """
    outer = angles(tangents)
    inner = angles(tangents_within_cover(pixels, lens, bare))
    inwards = _fit_polynomials(outer, inner)
    outwards = _fit_polynomials(inner, outer)
    # in single precision, as its readers hold them
    return np.concatenate([bare, inwards, outwards]).astype(np.float32).astype(np.float64)


def _fit_polynomials(source: Array, target: Array) -> Array:
    """Return (2 * TERMS,) coefficients of the map from (N, 2) source to (N, 2) target angles."""
    return np.asarray(np.linalg.lstsq(_terms(source), target, rcond=None)[0].T.ravel())


def project_windshield(lens: ExportLens, parameters: Array, tangents: Array) -> Array:
    """Return (N, 2) px of (N, 2) slopes x / z and y / z."""
    inwards = parameters[-4 * TERMS : -2 * TERMS].reshape(2, TERMS)
    inner = np.sin(_terms(angles(tangents)) @ inwards.T)
    forward = np.sqrt(np.maximum(1 - (inner**2).sum(-1, keepdims=True), 0.0))
    return project_slopes(parameters[: -4 * TERMS], inner / forward, lens.fisheye)[0]


def tangents_within_cover(pixels: Array, lens: ExportLens, bare: Array) -> Array:
    """Return (N, 2) x / z and y / z in front of the lens, of (N, 2) px."""
    path, values = pinhole_path(to_intrinsics(bare.tolist(), lens.fisheye))
    direction = path.trace(torch.from_numpy(pixels), values, MIDDLE).direction
    return np.asarray(torch.stack([direction.x, direction.y], -1) / direction.z.unsqueeze(-1))


def angles(tangents: Array) -> Array:
    """Return (N, 2) rad, phi and theta."""
    return np.asarray(np.arcsin(tangents / np.sqrt(1 + (tangents**2).sum(-1, keepdims=True))))


def _terms(phi_theta: Array) -> Array:
    """Return (N, TERMS) phi^i theta^j in the order of the coefficients."""
    phi, theta = phi_theta.T
    return np.column_stack(
        [phi**i * theta**j for j in range(ORDER + 1) for i in range(ORDER + 1 - j)]
    )
