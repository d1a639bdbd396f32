"""Fig. 7: the distortion at 1 m over the whole image, for a glass fitted as in the paper from 15
views with unknown poses.
"""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from benchmarks.paper.common import NOMINAL, THICKNESS, Result, procedure
from calib.optics.params import Values
from calib.optics.path import Path
from calib.progress import Progress
from calib.undistortion.ray_field import ray_field
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, paper_cone, scene

DEPTH = 1.0  # m
LEVELS = (2.5, 5.0, 10.0)  # px
COLUMNS = np.linspace(0, WIDTH - 1, WIDTH // 16)  # px
ROWS = np.linspace(0, HEIGHT - 1, HEIGHT // 16)  # px
MIDDLE = 1232  # px, the row of Fig. 8's pixels

Field = NDArray[np.float64]


def run(progress: Progress) -> Result:
    advance = progress.task("Fig. 7", 2)
    figure = Figure((10, 4.6), layout="constrained")
    lines = [
        f"Fig. 7  distortion at {DEPTH:g} m on {WIDTH}x{HEIGHT} px: cone + RBF (8x8),",
        (
            "        fitted by the paper's procedure to 15 noise-free views through bumps of 10 um"
            " (4x4)"
        ),
    ]
    for i, (axes, thickness) in enumerate(
        zip(figure.subplots(1, 2, sharey=True), (THICKNESS, NOMINAL), strict=True)
    ):
        made = scene(7, views=15, amplitude=1e-5, cover=paper_cone(thickness))
        fitted = procedure(INTRINSICS, paper_cone(thickness), made.observations, WIDTH, HEIGHT)
        field = _distortion(fitted.path, fitted.values)
        error = np.linalg.norm(field - _distortion(made.path, made.values), axis=-1)
        lines += [f"glass {1e3 * thickness:.2f} mm", *_where(np.linalg.norm(field, axis=-1))]
        off_true = f"{(error**2).mean() ** 0.5:.2f} px RMS, {error.max():.2f} px at most"
        lines.append(
            f"  left on the boards {fitted.final:.4f} cm (regular cone {fitted.cone:.4f}); off the"
            f" true field {off_true}, gauge included"
        )
        _draw(axes, field)
        axes.set_title(f"glass {1e3 * thickness:.2f} mm", fontsize=10)
        advance(i + 1, "")
    lines.append(
        "The paper: contours at 2.5, 5 and 10 px, without numbers for where they lie; large on the"
        " two lateral sides, little in the middle."
    )
    return Result("\n".join(lines), figure)


def _distortion(path: Path, values: Values) -> Field:
    """(rows, columns, 2) px: undistorted minus distorted pixel."""
    pixels = np.stack(np.meshgrid(COLUMNS, ROWS), -1)
    moved = ray_field(path, values, WIDTH, HEIGHT).undistort_pixels(pixels.reshape(-1, 2), DEPTH)
    return moved.reshape(pixels.shape) - pixels


def _crossings(size: Field, level: float) -> tuple[float, float]:
    """x, px, left and right, at which a contour crosses the middle row."""
    row = size[np.abs(ROWS - MIDDLE).argmin()]
    lowest = int(row.argmin())
    left_edge = np.interp(-level, -row[: lowest + 1], COLUMNS[: lowest + 1])
    return float(left_edge), float(np.interp(level, row[lowest:], COLUMNS[lowest:]))


def _where(size: Field) -> list[str]:
    """Return lines with the places of the contours and the distortion along the image's sides."""
    lines = []
    for level in LEVELS:
        left_edge, right = _crossings(size, level)
        sentence = f"{100 * (size < level).mean():.0f} % of the image lies within"
        lines.append(
            f"  {level:4.1f} px: crosses row {MIDDLE} at x = {left_edge:.0f} and {right:.0f};"
            f" {sentence}"
        )
    sides = {"left": size[:, 0], "right": size[:, -1], "top": size[0], "bottom": size[-1]}
    means = ", ".join(f"{name} {edge.mean():.1f}" for name, edge in sides.items())
    lines.append(
        f"  mean along the edges: {means} px; least {size.min():.2f} px, most {size.max():.1f} px"
    )
    return lines


def _draw(axes: Axes, field: Field) -> None:
    size = np.linalg.norm(field, axis=-1)
    axes.set_aspect("equal")
    lines = axes.contour(
        COLUMNS, ROWS, size, LEVELS, colors=["#6baed6", "#2f7fbf", "#08519c"], linewidths=1.5
    )
    places = [(x, MIDDLE) for level in LEVELS for x in _crossings(size, level)]
    axes.clabel(lines, fmt="%g px", fontsize=9, manual=places)
    interval = 13
    x, y = np.meshgrid(COLUMNS[interval // 2 :: interval], ROWS[interval // 2 :: interval])
    u, v = np.moveaxis(field[interval // 2 :: interval, interval // 2 :: interval], -1, 0)
    scale = size.max() / 200  # the longest arrow is 200 image pixels long
    arrows = axes.quiver(
        x, y, u, v, angles="xy", scale_units="xy", scale=scale, width=0.002, color="#777777"
    )
    axes.quiverkey(arrows, 0.88, -0.16, 10, "10 px", labelpos="E", fontproperties={"size": 9})
    axes.set(xlim=(0, WIDTH), ylim=(HEIGHT, 0), xlabel="x (px)", ylabel="y (px)")
