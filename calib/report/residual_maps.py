"""Figure: residuals averaged over image and board, by depth, and their distribution."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.estimation.noise import on_board_grid, short_scale_noise
from calib.fitting.corner_range import CELLS
from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing
from calib.report.patterns import GroupMeans, over_board, over_image
from calib.report.payload import Data
from calib.rounding import two_digits

BANDS = 10
"""The number of depth bands, which hold equally many corners."""
LENGTH_ON_BOARD = 10.0
"""mm of an arrow over the board, for which the caption says the error."""
VIEWS_PER_BAND = 3
"""Views of a band of which the noise is estimated: of fewer it varies too much to show a trend."""


@dataclass(frozen=True, slots=True)
class Arrows:
    """Mean errors at places of the image or of the board."""

    places: Array
    """(G, 2) px or mm"""
    means: GroupMeans
    title: str

    def data(self) -> Data:
        return {
            "place": self.places,
            "mean": self.means.mean,
            "significant": (self.means.significant & self.means.is_pattern).astype(np.int64),
            "title": self.title,
        }


@dataclass(frozen=True, slots=True)
class DepthBands:
    """The lengths of the errors in bands of depth."""

    middle: Array
    """(B,) m"""
    rms: Array
    """(B,) px"""
    low: Array
    """(B,) px; 16 % of the errors are smaller."""
    high: Array
    """(B,) px; 16 % of the errors are larger."""


def arrows_over_image(evidence: Evidence) -> Arrows:
    means = over_image(evidence)
    camera = evidence.calibration.camera
    x = camera.width * (np.arange(CELLS[0]) + 0.5) / CELLS[0] - 0.5
    y = camera.height * (np.arange(CELLS[1]) + 0.5) / CELLS[1] - 0.5
    places = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    longest = float(np.nanmax(means.length))
    return Arrows(places, means, f"mean error over the picture; longest arrow {longest:.2g} px")


def arrows_over_board(evidence: Evidence) -> Arrows:
    means = over_board(evidence)
    longest = float(np.nanmax(means.length))
    places = 1e3 * evidence.calibration.board.points()[:, :2]
    return Arrows(places, means, f"mean error over the board; longest arrow {longest:.2g} px")


@dataclass(frozen=True, slots=True)
class ArrowScales:
    """The drawn lengths of an arrow for each px of the mean error that it shows."""

    image: float
    """px of the image"""
    board: float
    """mm of the board"""

    @staticmethod
    def of(evidence: Evidence, typical: float) -> ArrowScales:
        """Return the scales at which an arrow of `typical` px is about as long as a cell."""
        camera = evidence.calibration.camera
        board = evidence.calibration.board
        span = 1e3 * board_span(evidence)
        return ArrowScales(
            float(two_digits(0.9 * camera.width / CELLS[0] / typical)),
            float(two_digits(1.8 * span / max(board.across, 8) / typical)),
        )

    @property
    def caption(self) -> str:
        return (
            f"Arrows over the picture are drawn {two_digits(self.image)} times as long as they are."
            f" Over the board, {LENGTH_ON_BOARD:g} mm of an arrow are an error of"
            f" {two_digits(LENGTH_ON_BOARD / self.board)} px."
        )

    def data(self) -> Data:
        return {"image": self.image, "board": self.board}


def board_span(evidence: Evidence) -> float:
    """Return how far the panel over the board reaches from its centre, m."""
    return 1.15 * max(evidence.calibration.board.half) or 1e-3


def typical_length(*arrows: Arrows) -> float:
    """Return a length in px that few of the arrows exceed, for their scale."""
    return max(float(np.nanquantile(item.means.length, 0.95)) for item in arrows) or 1e-3


def depth_bands(evidence: Evidence) -> DepthBands:
    lengths = np.linalg.norm(evidence.errors, axis=-1)
    bands = [
        band
        for band in np.array_split(np.argsort(evidence.distance), BANDS)
        if np.isfinite(lengths[band]).any()
    ]
    return DepthBands(
        np.array([evidence.distance[band].mean() for band in bands]),
        np.array([np.sqrt(np.nanmean(lengths[band] ** 2)) for band in bands]),
        np.array([np.nanquantile(lengths[band], 0.16) for band in bands]),
        np.array([np.nanquantile(lengths[band], 0.84) for band in bands]),
    )


def noise_by_distance(evidence: Evidence) -> tuple[Array, Array]:
    """Return the mean distances (B,) m of groups of views, near to far, and the corners' noise in
    them, (B,) px; groups with too few corners for an estimate are left out.
    """
    calibration = evidence.calibration
    views = len(calibration.views)
    counts = np.maximum(np.bincount(evidence.view, minlength=views), 1)
    distance = np.bincount(evidence.view, evidence.distance, views) / counts
    grid = on_board_grid(evidence.residuals.image, calibration.views)
    bands = max(1, min(BANDS, views // VIEWS_PER_BAND))
    noise = [
        (float(distance[band].mean()), short_scale_noise(grid[band], calibration.board))
        for band in np.array_split(np.argsort(distance), bands)
    ]
    estimates = [(middle, px) for middle, px in noise if px is not None]
    return np.array([middle for middle, _ in estimates]), np.array([px for _, px in estimates])


def highest_length(evidence: Evidence) -> float:
    """Return a length in px for the top of axes that show the errors' lengths."""
    lengths = np.linalg.norm(evidence.errors, axis=-1)
    return float(1.35 * np.nanquantile(lengths, 0.99) + 1e-9)


def residual_maps(evidence: Evidence) -> Drawing:
    in_image = arrows_over_image(evidence)
    on_board = arrows_over_board(evidence)
    scales = ArrowScales.of(evidence, typical_length(in_image, on_board))
    bands = depth_bands(evidence)
    target = "board" if evidence.calibration.board.is_flat else "target, seen along its z axis"
    noise = evidence.calibration.noise_px
    middle, noise_there = noise_by_distance(evidence)
    shape = "" if noise is None else " Its line is noise alone: a wider histogram is not all noise."
    return Drawing(
        "residuals",
        "Residuals, and where they are",
        f"Over the picture: {in_image.means.summary}. Over the {target}: {on_board.means.summary}.",
        explanation=(
            "An arrow is the mean of the reprojection errors there: the corner that the model"
            f" predicts minus the detected one. {scales.caption} The arrows of a pattern are"
            " orange. A pattern over the picture comes from the lens or the glass, one over the"
            " board from a board that is not flat or not to scale. The histogram has the x and y"
            f" of all errors.{shape} The noise by {evidence.distance_name} is that of groups of"
            " views: if the error exceeds it, the model lacks something."
        ),
        data={
            "image": in_image.data(),
            "board": on_board.data(),
            "scales": scales.data(),
            "span": 1e3 * board_span(evidence),
            "bands": {
                "middle": bands.middle,
                "rms": bands.rms,
                "low": bands.low,
                "high": bands.high,
            },
            "noise": noise,
            "noiseBands": {"middle": middle, "noise": noise_there},
            "highest": highest_length(evidence),
        },
    )
