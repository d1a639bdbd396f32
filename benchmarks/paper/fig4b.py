"""Fig. 4b: how many centres a glass with 10x10 bumps needs, around the cone and along it.

Noise-free, all poses known, 500 steps.
"""

from dataclasses import replace
from itertools import product

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from benchmarks.paper.common import THICKNESS, Result, relief_fit
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.optics.build import covered_path, with_relief
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.optics.relief import Relief
from calib.progress import Progress
from fixtures.synthetic import INTRINSICS, PATCH, Scene, paper_cone, scene

COUNTS = (2, 3, 4, 5, 7, 10)
# m, the mean: the middle of Fig. 4a's range; the standard deviation is a quarter of it, as there
AMPLITUDE = 1e-5
SEEDS = (0, 1)
WIDTHS = (1, 2)
"""The widths of the true Gaussians, in spacings of their centres (the square root of beta), which
the paper does not state.
"""


def run(progress: Progress) -> Result:
    advance = progress.task("Fig. 4b", len(WIDTHS) * len(SEEDS) * len(COUNTS) ** 2)
    smooth, values = covered_path(INTRINSICS, paper_cone(THICKNESS))
    cone = np.empty((len(WIDTHS), len(SEEDS)))  # cm
    rmse = np.empty(
        (len(WIDTHS), len(SEEDS), len(COUNTS), len(COUNTS))
    )  # cm; rows: along, columns: around
    done = 0
    for w, s in np.ndindex(cone.shape):
        made = scene(
            SEEDS[s], views=10, grid=(10, 10), amplitude=AMPLITUDE, cover=paper_cone(THICKNESS)
        )
        observations = _seen(made, WIDTHS[w])
        cone[w, s] = residuals(smooth, values, observations, made.poses).rmse_cm
        for (i, axial), (j, around) in product(enumerate(COUNTS), repeat=2):
            uneven, fitted = relief_fit(
                smooth, values, Relief(*PATCH, (axial, around)), observations, made.poses, steps=500
            )
            rmse[w, s, i, j] = residuals(uneven, fitted, observations, made.poses).rmse_cm
            done += 1
            advance(done, f"{around} around x {axial} along")
    return Result(_text(cone, rmse), _figure(cone, rmse))


def _seen(made: Scene, width: int) -> Observations:
    """The scene's corners through its bumps, made `width` spacings wide."""
    path = with_relief(made.path, Relief(*PATCH, (10, 10), beta=float(width**2)))
    observations = made.observations
    return replace(
        observations,
        pixels=project(
            path,
            made.values,
            path.place(observations.corners, made.values, made.poses[observations.view], MIDDLE),
            MIDDLE,
        ),
    )


def _text(cone: np.ndarray, rmse: np.ndarray) -> str:
    lines = [
        f"Fig. 4b  RMSE in cm of cone + RBF, mean of {len(SEEDS)} seeds; truth 10x10 centres, mean"
        " 10 um, sigma 2.5 um"
    ]
    for width, smooth, errors in zip(WIDTHS, cone.mean(1), rmse.mean(1), strict=True):
        lines += [
            (
                f"True Gaussians {width} spacing{'s' if width > 1 else ''} wide; regular cone"
                f" {smooth:.4f} cm"
            ),
            f"{'along | around':>16}" + "".join(f"{n:>9}" for n in COUNTS),
            *(
                f"{n:>16}" + "".join(f"{e:9.4f}" for e in row)
                for n, row in zip(COUNTS, errors, strict=True)
            ),
        ]
    five = COUNTS.index(5)
    seven = COUNTS.index(7)
    ten = COUNTS.index(10)
    lines.append(
        "The paper: 7x5 centres approximate the 10x10 surface well; more are needed around the cone"
        " than along it."
    )
    for width, smooth, errors in zip(WIDTHS, cone.mean(1), rmse.mean(1), strict=True):
        cells = {
            "7 around x 5 along": errors[five, seven],
            "5 x 7": errors[seven, five],
            "10 x 10": errors[ten, ten],
        }
        shares = ", ".join(f"{name} {100 * error / smooth:.2f} %" for name, error in cells.items())
        lines.append(f"Ours, width {width}: of the regular cone's error, {shares} are left.")
    return "\n".join(lines)


def _figure(cone: np.ndarray, rmse: np.ndarray) -> Figure:
    figure = Figure((10, 4.4), layout="constrained")
    shares = 100 * rmse.mean(1) / cone.mean(1)[:, None, None]
    norm = LogNorm(shares.min(), shares.max())
    for axes, width, share in zip(figure.subplots(1, len(WIDTHS)), WIDTHS, shares, strict=True):
        shown = axes.imshow(share, cmap="YlGnBu", norm=norm, origin="lower")
        for (i, j), value in np.ndenumerate(share):
            axes.text(
                j,
                i,
                f"{value:.2g}",
                ha="center",
                va="center",
                color="white" if norm(value) > 0.6 else "black",
                fontsize=9,
            )
        axes.set(
            xlabel="centres around the cone (horizontal)",
            ylabel="centres along the cone (vertical)",
        )
        axes.set_xticks(range(len(COUNTS)), COUNTS)
        axes.set_yticks(range(len(COUNTS)), COUNTS)
        axes.set_title(
            f"true Gaussians {width} spacing{'s' if width > 1 else ''} wide", fontsize=10
        )
    figure.colorbar(shown, ax=figure.axes, label="RMSE left, % of the regular cone's")
    return figure
