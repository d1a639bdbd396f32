"""Figures: the relief of the outer surface, its standard deviation, and the corners' exit points;
and the surface in detail, as a screen's points show it.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.errors import RefracalError
from calib.estimation.covariance import covariance_root
from calib.inference.glass_detail import MAX_VIEWS, GlassDetail, evenly, glass_detail
from calib.optics.relief import Relief
from calib.report.chart import ChartPanel
from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing
from calib.session.points_file import point_files, read_dense_points

NODES = (61, 46)
"""Columns and rows of the grid over the chart."""
MAX_COLUMNS = 140
"""Columns of the surface in detail."""


@dataclass(frozen=True, slots=True)
class Heights:
    """The relief over the chart, minus its mean over the visible part."""

    panel: ChartPanel
    x: Array
    """(w,) horizontal coordinates of the panel."""
    y: Array
    """(h,) vertical coordinates of the panel."""
    visible: NDArray[np.bool_]
    """(h, w) true where the image sees the glass."""
    height: Array
    """(h, w) um"""
    sigma: Array | None
    """(h, w) um; None where the fit estimated no covariance."""

    def range(self, values: Array) -> tuple[float, float]:
        """Return the smallest and the largest of (h, w) values that the image sees."""
        visible = values[self.visible]
        return float(visible.min()), float(visible.max())

    @property
    def height_title(self) -> str:
        low, high = self.range(self.height)
        return f"height: {low:+.2g} to {high:+.2g} µm"

    @property
    def sigma_title(self) -> str:
        assert self.sigma is not None
        smallest, largest = self.range(self.sigma)
        return f"its standard deviation: {smallest:.2g} to {largest:.2g} µm"

    @property
    def caption(self) -> str:
        caption = (
            "Height of the outer surface above its mean, in the part that the camera looks through."
            " The pictures hardly show the mean itself, because an even layer bends almost no"
            " light."
        )
        if self.sigma is None:
            return caption
        return caption + (
            " Dots: exit points of the corners' rays. Far from them, the prior decides."
        )


def glass_surface(evidence: Evidence) -> Drawing | None:
    """Return None without a relief."""
    relief = evidence.calibration.relief
    if not relief:
        return None
    glass = heights(evidence, relief)
    low, high = glass.range(glass.height)
    data: dict[str, object] = {
        **glass.panel.data(),
        "x": glass.x,
        "y": glass.y,
        "visible": glass.visible.astype(np.int64),
        "height": glass.height,
        "heightTitle": glass.height_title,
        "limit": max(-low, high) or 1.0,
    }
    if glass.sigma is not None:
        data |= {
            "sigma": glass.sigma,
            "sigmaTitle": glass.sigma_title,
            "sigmaLimit": 2 * float(np.median(glass.sigma[glass.visible])),
        }
    return Drawing("glass", "The glass surface", glass.caption, data)


def glass_in_detail(evidence: Evidence, session: Path | None) -> Drawing | None:
    """Return None where the session has no dense points."""
    detail = session and read_detail(evidence.calibration, session)
    if not detail:
        return None
    x, y, height = shrink_detail(detail)
    title, limit = describe_detail(height)
    data = {"x": x, "y": y, "height": height, "heightTitle": title, "limit": limit}
    caption = (
        "What the screen's points show of the outer surface beyond the relief, such as drops and"
        " scratches: its height where the rays of the picture leave it. Two halves of the poses"
        f" agree to {1e9 * detail.noise:.2g} nm."
    )
    return Drawing("glass-detail", "The glass in detail", caption, data)


def read_detail(calibration: Calibration, session: Path) -> GlassDetail | None:
    """Return the heights that the points of a session show; None where they are too few, or
    cannot be read any more.
    """
    if calibration.board.has_grid or not calibration.board.is_flat:
        return None
    camera, names = calibration.camera, {view.name for view in calibration.views}
    try:
        files = [file for file in point_files(session) if file.name in names]
        views = [
            read_dense_points(file, camera.width, camera.height)
            for file in evenly(files, MAX_VIEWS)
        ]
    except RefracalError:
        return None
    return glass_detail(calibration, views)


def describe_detail(height: Array) -> tuple[str, float]:
    """Return the title of a figure of (h, w) µm, and the largest height that its colours show."""
    low, high = float(np.nanmin(height)), float(np.nanmax(height))
    return f"height beyond the relief: {low:+.2g} to {high:+.2g} µm", max(-low, high) or 1.0


def shrink_detail(detail: GlassDetail) -> tuple[Array, Array, Array]:
    """Return (w,) px, (h,) px and (h, w) µm with at most MAX_COLUMNS columns."""
    factor = -(-len(detail.x) // MAX_COLUMNS)
    rows, columns = len(detail.y) // factor, len(detail.x) // factor
    blocks = detail.height[: rows * factor, : columns * factor]
    blocks = blocks.reshape(rows, factor, columns, factor).swapaxes(1, 2).reshape(rows, columns, -1)
    is_finite = np.isfinite(blocks)
    total = np.where(is_finite, blocks, 0.0).sum(-1)
    count = is_finite.sum(-1)
    height = np.where(count > 0, 1e6 * total / np.maximum(count, 1), np.nan)
    x = detail.x[: columns * factor].reshape(columns, factor).mean(1)
    y = detail.y[: rows * factor].reshape(rows, factor).mean(1)
    return x, y, height


def heights(evidence: Evidence, relief: Relief) -> Heights:
    panel = ChartPanel.of(evidence)
    low = panel.frame.min(0)
    high = panel.frame.max(0)
    x = np.linspace(low[0], high[0], NODES[0])
    y = np.linspace(low[1], high[1], NODES[1])
    outline = panel.frame.astype(np.float32)
    visible = np.array(
        [[cv2.pointPolygonTest(outline, (u, v), measureDist=False) > 0 for u in x] for v in y]
    )
    vertical_bells = relief.gaussians(torch.from_numpy(y / panel.scales[1]), 0)[0].numpy()
    horizontal_bells = relief.gaussians(torch.from_numpy(x / panel.scales[0]), 1)[0].numpy()
    basis = np.einsum("ip,jq->pqij", vertical_bells, horizontal_bells)
    basis *= evidence.path.relief_growth(evidence.values)
    shape = basis.shape[:2]
    basis = basis.reshape(visible.size, -1)  # (h w, amplitudes)
    mean = basis[visible.ravel()].mean(0)
    amplitudes = evidence.calibration.amplitudes.ravel()
    covariance = evidence.calibration.covariance[: len(amplitudes), : len(amplitudes)]
    sigma = None
    if covariance.size:
        root = 1e6 * covariance_root(covariance)
        sigma = np.linalg.norm((basis - mean) @ root, axis=-1).reshape(shape)
    return Heights(
        panel=panel,
        x=x,
        y=y,
        visible=visible,
        height=1e6 * ((basis - mean) @ amplitudes).reshape(shape),
        sigma=sigma,
    )
