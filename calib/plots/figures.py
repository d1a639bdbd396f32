"""The public functions of `calib.plots`, and the figures that `calib report --png` writes."""

from collections.abc import Callable, Sequence
from functools import lru_cache
from io import BytesIO
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calib.calibration import Calibration, CalibrationSource
from calib.io.file_set import FileSet
from calib.plots.fields import depth_figure, distortion_field, distortion_figure, sigma_figure
from calib.plots.residuals import board_error_figure, draw_over_image, residual_figure
from calib.plots.space import space_figure
from calib.plots.surfaces import coverage_figure, detail_figure, glass_figure
from calib.report.evidence import Evidence, gather_evidence
from calib.threads import single_thread

FIGURES: dict[str, Callable[[Evidence], Figure | None]] = {
    "scene.png": space_figure,
    "board-errors.png": board_error_figure,
    "residuals.png": residual_figure,
    "distortion.png": distortion_figure,
    "by-depth.png": depth_figure,
    "glass.png": glass_figure,
    "glass-detail.png": detail_figure,
    "sigma.png": sigma_figure,
    "coverage.png": coverage_figure,
}
"""Each file and the function that draws it; None: this calibration has no such figure."""
DPI = 200


def plot_residuals(calibration: CalibrationSource, ax: Axes) -> None:
    """Draw the mean residuals over the image as arrows, coloured where noise does not explain
    them.

    Args:
        calibration: the calibration, or the path of its file or folder.
        ax: the axes to draw into; they get the picture's coordinates, px.
    """
    with single_thread():
        draw_over_image(ax, _evidence(Calibration.of(calibration)))


def plot_distortion(calibration: CalibrationSource, depth: float, ax: Axes) -> None:
    """Draw undistorted minus distorted pixel over the image, for a scene at a depth in m.

    Args:
        calibration: the calibration, or the path of its file or folder.
        depth: m
        ax: the axes to draw into; they get the picture's coordinates, px.
    """
    with single_thread():
        distortion_field(ax, _evidence(Calibration.of(calibration)), depth)


def plot_scene(calibration: CalibrationSource) -> Figure:
    """Return a figure of the camera, its cover, and every board in the colour of its error.

    Args:
        calibration: the calibration, or the path of its file or folder.
    """
    with single_thread():
        return space_figure(_evidence(Calibration.of(calibration)))


def write_figures(
    calibration: Calibration, files: FileSet, depths: Sequence[float] = ()
) -> list[Path]:
    """Write the figures of a report as PNG, and return their paths.

    Args:
        depths: m, at which fields are drawn, as for the report.
    """
    written = []
    with single_thread():
        evidence = gather_evidence(calibration, tuple(depths))
        for name, drawing in FIGURES.items():
            if figure := drawing(evidence):
                buffer = BytesIO()
                figure.savefig(buffer, format="png", dpi=DPI, bbox_inches="tight")
                written.append(files.write(name, buffer.getvalue()))
    return written


@lru_cache(maxsize=1)  # several figures of one calibration
def _evidence(calibration: Calibration) -> Evidence:
    return gather_evidence(calibration)
