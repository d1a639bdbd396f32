"""The distortion field: the displacement of pixels from the pinhole camera's, at any depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.report.evidence import Array, Evidence


@dataclass(frozen=True, slots=True)
class Displacement:
    """Undistorted minus distorted pixel, which is affine in inverse depth; NaN where no ray leaves
    the cover, and where the undistorted picture does not show it (`Evidence.shows`).
    """

    at_infinity: Array
    """(..., 2) px, at infinite depth."""
    parallax: Array
    """(..., 2) px m, for each 1/m of inverse depth."""

    @staticmethod
    def of(evidence: Evidence, pixels: Array) -> Displacement:
        """Return the displacement of (..., 2) px."""
        field = evidence.field
        flat = pixels.reshape(-1, 2)
        column = _nearest_node(flat[:, 0], field.nodes_x)
        row = _nearest_node(flat[:, 1], field.nodes_y)
        visible = (field.valid[row, column] & evidence.shows(flat))[:, None]
        far = np.where(visible, field.undistort_pixels(flat, np.inf), np.nan)
        near = np.where(visible, field.undistort_pixels(flat, 1.0), np.nan)
        return Displacement((far - flat).reshape(pixels.shape), (near - far).reshape(pixels.shape))

    def at(self, depth: float) -> Array:
        """Return (..., 2) px for a scene at a depth in m."""
        return self.at_infinity + self.parallax / depth


def _nearest_node(pixels: Array, nodes: Array) -> NDArray[np.int64]:
    """Return the (N,) indices of the uniform (n,) nodes nearest to (N,) px."""
    index = np.rint((pixels - nodes[0]) / (nodes[1] - nodes[0])).astype(np.int64)
    return np.asarray(index.clip(0, len(nodes) - 1))


def lattice(evidence: Evidence, nodes: tuple[int, int]) -> tuple[Array, Array, Displacement]:
    """Return x (w,) and y (h,) px of a grid over the whole image, and the displacement of its
    (h, w) pixels.
    """
    camera = evidence.calibration.camera
    x = np.linspace(-0.5, camera.width - 0.5, nodes[0])
    y = np.linspace(-0.5, camera.height - 0.5, nodes[1])
    return x, y, Displacement.of(evidence, np.stack(np.meshgrid(x, y), -1))
