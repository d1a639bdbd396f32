"""Views that are simply worse: their corners scatter more than those of the other views, so they
weigh less.

A board that moved while it was exposed, a picture out of focus, a reflection: what such a view says
is true, only less exact. Corners that come from a file have no covariances, and where they have,
these know a picture's noise alone. So the scatter is taken from what a fit leaves, at a scale that
nothing smooth has (`calib.estimation.noise`): a view that is off as a whole, as of a board that
bends otherwise, is not worse.
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

VIEW_NOISE = "view_noise"
"""Of a calibration's settings: how many times noisier than the median view each of the worse ones
is, by its file.
"""
WORSE = 1.5
"""Times the median view's noise, from which a view weighs less: pictures of one session differ by
less. On the four measured sets whose corners come with no covariances the held-out error of the
other views falls by 0 to 0.5 %, and no further where every view has a weight by its own noise.
"""
SURE = 5.0
"""Standard deviations of a view's noise that this must be beyond the median's."""
SHOWN = 3
"""Of them, in a sentence."""


def with_own_noise(
    views: Sequence[View], observations: Observations, missed: Residuals, board: Board
) -> tuple[tuple[View, ...], dict[str, float]]:
    """The views, the corners of the worse ones weighing less, and how many times noisier these are,
    the worst first.
    """
    weighed = missed.image * observations.weight[:, None].to(missed.image)
    noise, spread = noise_of_views(on_board_grid(torch.as_tensor(weighed), views), board)
    known = np.isfinite(noise)
    if not known.any() or not (median := float(np.median(noise[known]))) > 0:
        return tuple(views), {}
    times = np.where(known, noise / median, 1.0)
    worse = times > np.maximum(WORSE, 1 + SURE * spread)
    lighter = (
        replace(view, weight=view.weight / by) if out else view
        for view, by, out in zip(views, times.tolist(), worse, strict=True)
    )
    said = {
        view.name: float(f"{by:.3g}")
        for view, by, out in zip(views, times.tolist(), worse, strict=True)
        if out
    }
    return tuple(lighter), dict(sorted(said.items(), key=lambda item: -item[1]))


def noisier(worse: Mapping[str, float]) -> str:
    """One sentence of them; empty where there are none."""
    if not worse:
        return ""
    shown = ", ".join(f"{name} ({times:.1f} times)" for name, times in list(worse.items())[:SHOWN])
    more = f" and {len(worse) - SHOWN} more" if len(worse) > SHOWN else ""
    are, weigh = (
        ("1 view is", "weighs") if len(worse) == 1 else (f"{len(worse)} views are", "weigh")
    )
    return f"{are} noisier than the others, and {weigh} less: {shown}{more}."
