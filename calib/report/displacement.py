"""How far pixels are from where a bare pinhole camera would have them, at any depth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.report.evidence import Array, Evidence


@dataclass(frozen=True, slots=True)
class Displacement:
    """Undistorted minus distorted pixel, which is affine in inverse depth; NaN where no ray leaves
    the cover, or where it is not shown (`Evidence.shows`).
    """

    at_infinity: Array
    """(..., 2) px, at infinite depth."""
    parallax: Array
    """(..., 2) px m, for each 1/m of inverse depth."""

    @staticmethod
    def of(evidence: Evidence, pixels: Array) -> Displacement:
        """Args: pixels: (..., 2) px."""
        field, flat = evidence.field, pixels.reshape(-1, 2)
        column, row = (
            np.rint((at - own[0]) / (own[1] - own[0])).astype(int).clip(0, len(own) - 1)
            for at, own in zip(flat.T, (field.nodes_x, field.nodes_y), strict=True)
        )
        visible = field.valid[row, column] & evidence.shows(flat)
        far, near = (
            np.where(visible[:, None], field.undistorted(flat, depth), np.nan)
            for depth in (np.inf, 1.0)
        )
        return Displacement((far - flat).reshape(pixels.shape), (near - far).reshape(pixels.shape))

    def at(self, depth: float) -> Array:
        """(..., 2) px at depth m."""
        return self.at_infinity + self.parallax / depth


def lattice(evidence: Evidence, nodes: tuple[int, int]) -> tuple[Array, Array, Displacement]:
    """x (w,) and y (h,) px of a grid over the image from border to border, and the displacement of
    its (h, w) pixels.
    """
    camera = evidence.calibration.camera
    x, y = (
        np.linspace(-0.5, size - 0.5, n)
        for size, n in zip((camera.width, camera.height), nodes, strict=True)
    )
    return x, y, Displacement.of(evidence, np.stack(np.meshgrid(x, y), -1))
