"""Fig. 8: the distortion against the inverse depth, and the thickness of the glass that it
implies.
"""

from collections.abc import Sequence

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from benchmarks.paper.common import BLUE, GREY, NOMINAL, ORANGE, THICKNESS, Result
from calib.optics.build import covered_path
from calib.optics.exposure import MIDDLE
from calib.optics.params import Values
from calib.optics.path import Path
from calib.progress import Progress
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, paper_cone, scene

INVERSE = np.linspace(0.5, 10, 39)  # 1/m
PIXELS = ((820.0, 1232.0), (410.0, 1232.0))
PAPER = np.array([1.64, 2.4])  # px, the change of the norm over INVERSE at PIXELS
GRID = np.stack(
    np.meshgrid(np.linspace(0, WIDTH - 1, 83), np.linspace(0, HEIGHT - 1, 62)), -1
).reshape(-1, 2)  # px, for the mean
DRAWS = 10

Floats = NDArray[np.float64]


def run(progress: Progress) -> Result:
    advance = progress.task("Fig. 8", 3)
    lines = [
        "Fig. 8  distortion norm over inverse depth 0.5 to 10 1/m, perfect cone",
        (
            f"{'glass':>10}{'at':>14}{'0.5 1/m':>12}{'10 1/m':>12}{'change':>12}{'paper':>12}{'R^2 of a line':>16}"  # noqa: E501
        ),
    ]
    figure = Figure((10, 4), layout="constrained")
    for axes, thickness in zip(figure.subplots(1, 2), (THICKNESS, NOMINAL), strict=True):
        curves, bend = _curves(thickness)
        for name, curve, paper in zip(
            ("(820, 1232)", "(410, 1232)", "image mean"),
            curves,
            ("1.64 px", "2.4 px", "-"),
            strict=True,
        ):
            cells = (
                f"{curve[0]:9.2f} px{curve[-1]:9.2f} px{curve[-1] - curve[0]:9.3f}"
                f" px{paper:>12}{_r2(curve):16.6f}"
            )
            lines.append(f"{1e3 * thickness:7.2f} mm{name:>14}{cells}")
        lines.append(f"{'':10}  x and y components: off a straight line by {bend:.0e} px at most")
        _draw(axes, curves, thickness)
        advance(1 if thickness == THICKNESS else 2, "")
    best = minimize_scalar(
        lambda t: float(((_changes(t) - PAPER) ** 2).sum()),
        bounds=(5e-4, 5e-3),
        method="bounded",
        options={"xatol": 1e-7},
    ).x
    fitted, nominal, bumpy = _changes(best), _changes(NOMINAL), _bumpy(best)
    lines += [
        (
            f"The thickness that reproduces both best: {1e3 * best:.3f} mm, with {fitted[0]:.3f}"
            f" and {fitted[1]:.3f} px; index 1.5 assumed."
        ),
        (
            f"At 3 mm the changes are {nominal[0] / PAPER[0]:.2f} and {nominal[1] / PAPER[1]:.2f}"
            " times the paper's."
        ),
        (
            f"Bumps of 10 um ({DRAWS} draws, 4x4) on that glass spread the changes over"
            f" {_span(bumpy[:, 0])} and {_span(bumpy[:, 1])} px."
        ),
    ]
    advance(3, "")
    return Result("\n".join(lines), figure)


def _norms(path: Path, values: Values, pixels: Floats) -> tuple[Floats, float]:
    """(N, depths) px distortion norms, traced depth by depth; and how far, px, their components are
    off straight lines.
    """
    rays = path.trace(torch.from_numpy(pixels), values, MIDDLE)
    depths = torch.from_numpy(1 / INVERSE)
    points = (
        rays.at_depth(depths[:, None]).numpy() * INVERSE[:, None, None]
    )  # (depths, N, 2) x / z and y / z
    camera = np.array(
        [
            [float(values[f"camera.{name}"]) for name in pair]
            for pair in (("fx", "fy"), ("cx", "cy"))
        ]
    )
    vectors = points * camera[0] + camera[1] - pixels
    flat = vectors.reshape(len(INVERSE), -1)
    line = np.polynomial.polynomial.polyfit(INVERSE, flat, 1)
    return np.linalg.norm(vectors, axis=-1).T, float(
        np.abs(flat - line[0] - INVERSE[:, None] * line[1]).max()
    )


def _curves(thickness: float) -> tuple[list[Floats], float]:
    """The norm at the two pixels and its mean over the image, (depths,) px each; the worst bend of
    a component, px.
    """
    path, values = covered_path(INTRINSICS, paper_cone(thickness))
    at_pixels, _ = _norms(path, values, np.array(PIXELS))
    on_grid, bend = _norms(path, values, GRID)
    return [*at_pixels, on_grid.mean(0)], bend


def _changes(thickness: float) -> Floats:
    """(2,) px: the change of the norm at the two pixels."""
    at_pixels, _ = _norms(*covered_path(INTRINSICS, paper_cone(thickness)), np.array(PIXELS))
    return np.asarray(at_pixels[:, -1] - at_pixels[:, 0])


def _bumpy(thickness: float) -> Floats:
    """(draws, 2) px: the same through uneven glass."""
    glasses = [
        scene(seed, views=1, amplitude=1e-5, cover=paper_cone(thickness)) for seed in range(DRAWS)
    ]
    return np.array(
        [
            (at_pixels := _norms(g.path, g.values, np.array(PIXELS))[0])[:, -1] - at_pixels[:, 0]
            for g in glasses
        ]
    )


def _r2(curve: Floats) -> float:
    return float(np.corrcoef(INVERSE, curve)[0, 1] ** 2)


def _span(changes: Floats) -> str:
    return f"{changes.min():.2f}-{changes.max():.2f}"


def _draw(axes: Axes, curves: Sequence[Floats], thickness: float) -> None:
    for curve, name, colour in zip(
        curves,
        ("pixel (820, 1232)", "pixel (410, 1232)", "image mean"),
        (BLUE, ORANGE, GREY),
        strict=True,
    ):
        axes.plot(INVERSE, curve, color=colour, label=f"{name}: +{curve[-1] - curve[0]:.2f} px")
    axes.set(
        xlabel="inverse depth (1/m)", ylabel="distortion norm (px)", xlim=(0, 10.2), ylim=(0, None)
    )
    axes.set_title(f"glass {1e3 * thickness:.2f} mm", fontsize=10)
    axes.grid(True, color="#dddddd", linewidth=0.6)
    axes.legend(frameon=False, fontsize=9)
