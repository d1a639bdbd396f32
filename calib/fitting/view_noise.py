"""Weigh the noisy views less: those whose corners scatter more than the corners of other views.

If the board moved during the exposure, or the picture is out of focus or has a reflection, the
corners of a view are unbiased but less exact. Corners from a file have no covariances, and the
covariances of detected corners account for the picture's noise only. So the scatter is estimated
from a fit's residuals, at a scale shorter than any smooth model error (`calib.estimation.noise`). A
view whose residuals are large but smooth, for example because its board bends differently, is not
noisy.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch

from calib.corners.view import View
from calib.estimation.noise import noise_of_views, on_board_grid
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals
from calib.session.board import Board

NOISE_RATIO = 1.5
"""Noise over that of the median view, from which a view weighs less: pictures of one session differ
by less. On the four measured sets whose corners come without covariances, the held-out error of the
other views falls by 0 to 0.5 %, and no further if each view is weighted by its own noise.
"""
MIN_SIGNIFICANCE = 5.0
"""Standard deviations of a view's noise by which it must exceed the median."""
MAX_LISTED = 3
"""The most noisy views that a sentence names."""


def weigh_noisy_views(
    views: Sequence[View], observations: Observations, residual: Residuals, board: Board
) -> tuple[tuple[View, ...], dict[str, float]]:
    """Return the views, with smaller weights for the noisy ones, and by file how many times the
    median noise these have, the largest first.
    """
    weighted = residual.image * observations.weight[:, None].to(residual.image)
    noise, spread = noise_of_views(on_board_grid(torch.as_tensor(weighted), views), board)
    measured = np.isfinite(noise)
    if not measured.any() or not (median := float(np.median(noise[measured]))) > 0:
        return tuple(views), {}
    ratios = np.where(measured, noise / median, 1.0)
    noisy = ratios > np.maximum(NOISE_RATIO, 1 + MIN_SIGNIFICANCE * spread)
    weighted_views = (
        replace(view, weight=view.weight / ratio) if is_noisy else view
        for view, ratio, is_noisy in zip(views, ratios.tolist(), noisy, strict=True)
    )
    noise_ratios = {
        view.name: float(f"{ratio:.3g}")
        for view, ratio, is_noisy in zip(views, ratios.tolist(), noisy, strict=True)
        if is_noisy
    }
    return tuple(weighted_views), dict(sorted(noise_ratios.items(), key=lambda item: -item[1]))


def describe_noisy_views(noise_ratios: Mapping[str, float] | None) -> str:
    """Return one sentence about the noisy views; empty if there are none."""
    if not noise_ratios:
        return ""
    count = len(noise_ratios)
    names = ", ".join(
        f"{name} ({ratio:.1f} times)" for name, ratio in list(noise_ratios.items())[:MAX_LISTED]
    )
    remainder = f" and {count - MAX_LISTED} more" if count > MAX_LISTED else ""
    subject, verb = ("1 view is", "weighs") if count == 1 else (f"{count} views are", "weigh")
    return f"{subject} noisier than the others, and {verb} less: {names}{remainder}."
