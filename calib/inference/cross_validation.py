"""Cross-validation of one model against another: their errors on held-out views, and whether the
difference is more than chance.

Whole poses of the board are held out, by folds or by bands of depth, never single corners. An
interval comes from a bootstrap over views, a p-value from a permutation test that flips the signs
of the views' gains.

Source: B. Efron, R. Tibshirani, An introduction to the bootstrap (1993), chapter 13.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.inference.approximate_cv import without_each
from calib.inference.score_test import Optimum
from calib.inference.sign_flip_test import views_agree, views_gain

Array = NDArray[np.float64]

FOLDS = 5
BANDS = 3
"""Of depth."""
BANDED = 1.3
"""The farthest band's depth over the nearest's, from which a session has bands."""
DRAWS = 4000
"""Of the bootstrap."""
CLIP = 2.5
"""Times the typical error of a corner: what is farther off counts as that far, for single bad
corners are not the model's.
"""


@dataclass(frozen=True, slots=True, eq=False)
class HeldOut:
    """Each view's error when it was held out."""

    missed: Array
    """(M, 2) px, what is left of every corner; NaN where it was not scored, infinite where the
    model cannot see it.
    """
    view: NDArray[np.int64]
    """(M,) the pose of the board."""
    weight: Array
    """(M,) from 0 to 1, how surely the fit that did not see a corner predicts it: the noise's part
    of the predicted variance.
    """
    half: bool
    """Whether the views' own parameters are those of half of their corners, and the others were
    scored.
    """

    @property
    def squares(self) -> Array:
        """(M,) px^2 of every corner, NaN or infinite as it is."""
        return np.asarray((self.missed**2).sum(1))

    def by_view(self, limit: float, weight: Array) -> Array:
        """(V,) px^2, weighted mean of the clipped squares."""
        squares = self.squares
        scored = ~np.isnan(squares)
        own, view = weight[scored], self.view[scored]
        total = np.bincount(view, own * np.minimum(squares, limit)[scored], self.view.max() + 1)
        return np.asarray(total / np.bincount(view, own, self.view.max() + 1).clip(1e-300))

    @property
    def rms(self) -> float:
        """px, of all corners that the model sees."""
        squares = self.squares
        return float(np.sqrt(squares[np.isfinite(squares)].mean()))

    @property
    def limit(self) -> float:
        """px^2: `by_view`'s, from these errors."""
        return float(CLIP**2 * np.nanmedian(self.squares) / np.log(2))


@dataclass(frozen=True, slots=True)
class Gain:
    """By how much one model leaves less than another on held-out views."""

    before: float
    """px RMS"""
    after: float
    ci95: tuple[float, float]
    """px, of the difference."""
    p_value: float
    """How often chance alone does as much."""
    presence: float
    """How often chance alone makes what other views say of the difference agree as well with what
    held-out views leave. 1 where halves of views were scored.
    """

    @property
    def relative(self) -> float:
        return 1.0 - self.after / self.before

    @property
    def explained(self) -> float:
        """px RMS, what the one model explains of the error and the other does not; 0 where it
        leaves more.
        """
        return math.sqrt(max(0.0, self.before**2 - self.after**2))


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Views that are held out together, one part after the other."""

    part: NDArray[np.int64]
    """(V,) from 0 on."""
    pose: NDArray[np.int64]
    """(V,) of the board, from 0 on: the pictures of a burst share one.

    They are always in the same part, and count as one view.
    """


def folds(poses: Sequence[int] | NDArray[np.int64]) -> Split:
    """Every FOLDS-th pose of the board."""
    pose = _numbered(poses)
    return Split(pose % FOLDS, pose)


def bands(depths: Array, poses: Sequence[int] | NDArray[np.int64]) -> Split | None:
    """Near, middle and far poses, equally many each; None where all are at much the same depth.

    Args:
        depths: (V,) m.
        poses: (V,)
    """
    pose = _numbered(poses)
    depth = np.bincount(pose, depths) / np.bincount(pose)
    band = depth.argsort().argsort() * BANDS // len(depth)
    nearest, farthest = (np.median(depth[band == end]) for end in (0, BANDS - 1))
    return Split(band[pose], pose) if farthest > BANDED * nearest else None


def _numbered(poses: Sequence[int] | NDArray[np.int64]) -> NDArray[np.int64]:
    return np.unique(poses, return_inverse=True)[1].astype(np.int64)


def hold_out(
    model: CameraModel,
    observations: Observations,
    fitted: JointFit,
    split: Split,
    *,
    half: bool = False,
) -> HeldOut:
    """Fit without each part of the views, and score it.

    Args:
        fitted: to all views; the other fits start there, with its noise and prior.
        half: fit the parameters of a held-out view to every other corner and score the rest, as
            parameters of single views ask for.
    """
    scored = torch.ones(len(observations.pixels), dtype=torch.bool)
    part = torch.from_numpy(split.part)[observations.view]
    if half:
        for index in range(int(part.max()) + 1):
            scored[(part == index).nonzero()[::2]] = False
    missed, weight = (
        torch.full((len(scored), 2), torch.nan, dtype=torch.float64),
        torch.zeros(len(scored), dtype=torch.float64),
    )
    each = without_each(Optimum(model, observations, fitted), split.part, ~scored if half else None)
    for index, left in enumerate(each):
        out = part == index
        missed[out] = torch.where(scored[out, None], left.missed, torch.nan)
        weight[out] = 1 / (1 + left.spread)
    return HeldOut(missed.numpy(), split.pose[observations.view.numpy()], weight.numpy(), half)


def gain(before: HeldOut, after: HeldOut) -> Gain:
    """Compare on the same views: an interval by bootstrap over views, and a test by flipping the
    signs of the views' gains, which are as often losses if the models are alike. A corner counts
    the less, the less surely the first fit predicts it.
    """
    one, two = (held.by_view(before.limit, before.weight) for held in (before, after))
    rng = np.random.default_rng(0)
    drawn = rng.integers(0, len(one), (DRAWS, len(one)))
    low, high = np.quantile(
        np.sqrt(one[drawn].mean(1)) - np.sqrt(two[drawn].mean(1)), [0.025, 0.975]
    )
    presence = 1.0 if after.half else views_agree(_agreement(before, after))
    return Gain(
        float(np.sqrt(one.mean())),
        float(np.sqrt(two.mean())),
        (float(low), float(high)),
        views_gain(one, two),
        presence,
    )


def _agreement(before: HeldOut, after: HeldOut) -> Array:
    """(V,) px^2, of what the one model leaves with what the other takes from it, summed over the
    corners that are no outliers.

    Both fit a view's pose to all of its corners, so what these leave is the view's own noise, and
    what one takes from the other is by views
    that it is independent of: without the effect the products are as often negative.
    """
    known = (before.squares < before.limit) & np.isfinite(
        after.squares
    )  # not by how large these are: where they disagree, they are larger
    left, taken = before.missed[known], before.missed[known] - after.missed[known]
    own = before.weight[known] * (left * taken).sum(1)
    return np.asarray(np.bincount(before.view[known], own, before.view.max() + 1), np.float64)
