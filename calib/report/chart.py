"""The chart of the outer surface: exit points of rays in mm and degrees, and its axes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.inference.glass_detail import exit_chart
from calib.report.evidence import Array, Evidence
from calib.session.shapes.registry import find_shape

BORDER_POINTS = 40
"""Points on each side of the picture's border."""


@dataclass(frozen=True, slots=True)
class ChartPanel:
    """The axes of a figure over the outer surface."""

    labels: tuple[str, str]
    """The labels of the horizontal and the vertical axis."""
    scales: tuple[float, float]
    """The units of the axes in one SI unit."""
    frame: Array
    """(N, 2) the border of the region that the image sees, in the units of the axes."""

    @staticmethod
    def of(evidence: Evidence) -> ChartPanel:
        chart = find_shape(evidence.calibration.cover.covers[-1].shape).chart
        assert chart
        vertical, horizontal = chart
        scales = horizontal.per_si, vertical.per_si
        frame = border(evidence)[:, ::-1] * scales
        return ChartPanel((horizontal.label, vertical.label), scales, frame)

    def place(self, chart: Array) -> Array:
        """Return (N, 2) horizontal and vertical coordinates of (N, 2) chart coordinates, SI."""
        return np.asarray(chart[:, ::-1] * self.scales)

    def data(self) -> dict[str, object]:
        return {"labels": self.labels, "frame": self.frame}


def exit_points(evidence: Evidence, pixels: Array) -> Array:
    """Return the (N, 2) chart coordinates, SI, where the rays of (N, 2) px leave the glass; NaN
    where no ray does.
    """
    return exit_chart(evidence.path, evidence.values, pixels)


def border_pixels(evidence: Evidence, count: int) -> Array:
    """Return (4 count, 2) px around the border of the image."""
    camera = evidence.calibration.camera
    ramp, zero = np.linspace(0, 1, count), np.zeros(count)
    sides = ((ramp, zero), (1 + zero, ramp), (1 - ramp, 1 + zero), (zero, 1 - ramp))
    fractions = np.concatenate([np.stack(side, -1) for side in sides])
    return np.asarray(fractions * [camera.width, camera.height] - 0.5)


def border(evidence: Evidence) -> Array:
    """Return (N, 2) chart coordinates of the image border, without points that no ray reaches."""
    points = exit_points(evidence, border_pixels(evidence, BORDER_POINTS))
    return np.asarray(points[np.isfinite(points).all(-1)])
