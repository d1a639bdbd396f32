"""The windshield model of NVIDIA's NCore and of gsplat: a lens behind two polynomials that turn a
ray, fitted to known directions.

Of a unit ray (x, y, z), phi = asin x and theta = asin y. What they are within the cover, before the
lens, are polynomials in what they are outside, with every term up to ORDER, those without theta
first: c0 + c1 phi + ... + (c6 + c7 phi + ...) theta + ... . One pair leads inwards, for points to
pixels, another outwards, for pixels to rays. Each is a least squares over a grid of pixels, so
neither is the other's inverse.

Source: BivariateWindshieldModel in ncore/impl/sensors/camera.py of NCore;
    gsplat/cuda/_torch_external_distortion.py says the same.
"""

import numpy as np
import torch
from numpy.typing import NDArray

from calib.export.formats import ExportLens
from calib.export.lens_fit import as_intrinsics, project
from calib.optics.build import pinhole_path

Array = NDArray[np.float64]

ORDER = 5
"""The highest that gsplat takes."""
TERMS = (ORDER + 1) * (ORDER + 2) // 2


def fit_windshield(tangents: Array, pixels: Array, lens: ExportLens, own: Array) -> Array:
    """The (4 + coefficients,) parameters: those of the bare camera, then both polynomials inwards
    and both outwards.

    Args:
        tangents: (N, 2) x / z and y / z of what each pixel sees.
        pixels: (N, 2) px
        lens: the form.
        own: fx, fy, cx, cy px and the coefficients of the bare camera's lens.
    """
    outside, within = angles(tangents), angles(within_cover(pixels, lens, own))
    inwards, outwards = (
        np.linalg.lstsq(_terms(a), b, rcond=None)[0].T.ravel()
        for a, b in ((outside, within), (within, outside))
    )
    return (
        np.concatenate([own, inwards, outwards]).astype(np.float32).astype(np.float64)
    )  # as its readers hold them


def project_windshield(lens: ExportLens, parameters: Array, tangents: Array) -> Array:
    """(N, 2) px of (N, 2) slopes x / z and y / z."""
    inwards = parameters[-4 * TERMS : -2 * TERMS].reshape(2, TERMS)
    within = np.sin(_terms(angles(tangents)) @ inwards.T)
    ahead = np.sqrt(np.maximum(1 - (within**2).sum(-1, keepdims=True), 0.0))
    return project(parameters[: -4 * TERMS], within / ahead, lens.fisheye)[0]


def within_cover(pixels: Array, lens: ExportLens, own: Array) -> Array:
    """(N, 2) x / z and y / z before the lens, of (N, 2) px."""
    path, values = pinhole_path(as_intrinsics(own.tolist(), lens.fisheye))
    direction = path.trace(torch.from_numpy(pixels), values).direction
    return np.asarray(torch.stack([direction.x, direction.y], -1) / direction.z.unsqueeze(-1))


def angles(tangents: Array) -> Array:
    """(N, 2) rad, phi and theta."""
    return np.asarray(np.arcsin(tangents / np.sqrt(1 + (tangents**2).sum(-1, keepdims=True))))


def _terms(both: Array) -> Array:
    """(N, TERMS) phi^i theta^j in the order of the coefficients."""
    phi, theta = both.T
    return np.column_stack(
        [phi**i * theta**j for j in range(ORDER + 1) for i in range(ORDER + 1 - j)]
    )
