"""A ray tracer that shares nothing with calib.optics: numpy, one ray at a time, bisection, numeric
normals, Snell by angles. And derivatives by torch's reverse passes.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

Vec = NDArray[np.float64]


def bisect(function: Callable[[float], float], low: float, high: float) -> float:
    assert function(low) < 0 < function(high)
    for _ in range(200):
        middle = (low + high) / 2
        low, high = (middle, high) if function(middle) < 0 else (low, middle)
    return low


def bend(direction: Vec, normal: Vec, n_from: float, n_to: float) -> Vec:
    """Snell by angles, in the plane of incidence."""
    normal = normal / np.linalg.norm(normal)
    normal = normal if normal @ direction > 0 else -normal
    tangent = direction - (direction @ normal) * normal
    sine_in = np.linalg.norm(tangent)
    if sine_in < 1e-15:
        return direction
    angle = np.arcsin(n_from / n_to * sine_in)
    return np.asarray(np.cos(angle) * normal + np.sin(angle) * tangent / sine_in)


def gradient(function: Callable[[Vec], float], point: Vec, size: float = 1e-5) -> Vec:
    """Fourth-order central differences."""
    gradient = np.empty(3)
    for axis, step in enumerate(np.eye(3) * size):
        near = function(point + step) - function(point - step)
        far = function(point + 2 * step) - function(point - 2 * step)
        gradient[axis] = (8 * near - far) / (12 * size)
    return gradient


def through(
    surfaces: Sequence[tuple[Callable[[Vec], float], float, float]],
    origin: Vec,
    direction: Vec,
    reach: float,
) -> tuple[Vec, Vec]:
    """A ray through surfaces given as (height above it, index before, index behind)."""
    for height, n_from, n_to in surfaces:
        distance = bisect(lambda t, o=origin, d=direction, f=height: f(o + t * d), 0.0, reach)  # type: ignore[misc]
        origin = origin + distance * direction
        direction = bend(direction, gradient(height, origin), n_from, n_to)
    return origin, direction


def bumps(
    centres: NDArray[np.float64], amplitudes: NDArray[np.float64], widths: tuple[float, float]
) -> Callable[[float, float], float]:
    """The paper's equation 1 as a plain sum: centres (n, 2), amplitudes (n,), widths the Gaussians'
    sigma in each coordinate.
    """

    def height(first: float, second: float) -> float:
        offset = (np.array([first, second]) - centres) / widths
        return float(amplitudes @ np.exp(-0.5 * (offset**2).sum(-1)))

    return height


def row_derivatives(outputs: Tensor, inputs: Sequence[Tensor]) -> list[Tensor]:
    """Return the derivatives of a function whose output rows depend on their own input rows only.

    Args:
        outputs: (N, k), computed from the inputs.
        inputs: (N, ...) each, requiring gradients: row n of the outputs depends on row n alone.

    Returns:
        The (N, k, ...) derivative by each input, zero where the outputs do not depend on it.
    """
    k = outputs.shape[-1]
    passes = [
        torch.autograd.grad(
            outputs[..., i].sum(),
            inputs,
            retain_graph=i < k - 1,
            allow_unused=True,
            materialize_grads=True,
        )
        for i in range(k)
    ]
    return [torch.stack(columns, 1) for columns in zip(*passes, strict=True)]
