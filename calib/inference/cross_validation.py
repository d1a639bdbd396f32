"""Cross-validation of two models: their errors on held-out views, and whether the difference is
more than chance.

Whole poses of the board are held out, by folds or by depth bands, never single corners. A bootstrap
over views gives the interval of the gain. A permutation test that flips the signs of the views'
gains gives the p-value.

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
from calib.inference.approximate_cv import fits_without
from calib.inference.fitted_model import FittedModel
from calib.inference.sign_flip_test import gain_p_value, sign_flip_p_value

Array = NDArray[np.float64]

FOLDS = 5
MIN_CONFIRMING_VIEWS = 2 * FOLDS
"""The fewest views with which an effect can be accepted; with fewer, scores are reported."""
DEPTH_BANDS = 3
MIN_DEPTH_RATIO = 1.3
"""The smallest ratio between the depths of the farthest and the nearest band."""
BOOTSTRAP_DRAWS = 4000
CLIP = 2.5
"""A multiple of the typical corner error. Larger errors count as that large, because the model is
not responsible for single bad corners.
"""


@dataclass(frozen=True, slots=True, eq=False)
class HeldOutErrors:
    """The errors of each view in the fit without it."""

    residual: Array
    """(M, 2) px for every corner; NaN if it was not scored, infinite if the model cannot see it."""
    view: NDArray[np.int64]
    """(M,) the pose of the board."""
    weight: Array
    """(M,) from 0 to 1, the part of the predicted variance that is noise."""
    half: bool
    """True if the views' own parameters were fitted to half of their corners, and the other half
    was scored.
    """

    @property
    def squares(self) -> Array:
        """(M,) px^2 of every corner; NaN or infinite like `residual`."""
        return np.asarray((self.residual**2).sum(1))

    def by_view(self, limit: float, weight: Array) -> Array:
        """Return (V,) px^2, the weighted means of the squares, clipped at `limit` px^2."""
        squares = self.squares
        scored = ~np.isnan(squares)
        weights = weight[scored]
        view = self.view[scored]
        views = self.view.max() + 1
        sums = np.bincount(view, weights * np.minimum(squares, limit)[scored], views)
        return np.asarray(sums / np.bincount(view, weights, views).clip(1e-300))

    @property
    def rms(self) -> float:
        """The root mean square error in px of all corners that the model sees."""
        squares = self.squares
        return float(np.sqrt(squares[np.isfinite(squares)].mean()))

    @property
    def limit(self) -> float:
        """The limit in px^2 for `by_view`, from these errors."""
        return float(CLIP**2 * np.nanmedian(self.squares) / np.log(2))


@dataclass(frozen=True, slots=True)
class HeldOutGain:
    """The decrease of the held-out error from a base model to an extended one."""

    base_px: float
    """The root mean square error of the base model."""
    extended_px: float
    """The root mean square error of the extended model."""
    ci95: tuple[float, float]
    """The 95 % interval of the difference in px."""
    p_value: float
    """The probability of such a gain by chance."""
    presence_p_value: float
    """The probability that the difference which other views predict agrees by chance as well with
    the residual of held-out views. 1 if halves of views were scored.
    """

    @property
    def relative(self) -> float:
        """The relative decrease of the error."""
        return 1.0 - self.extended_px / self.base_px

    @property
    def explained_px(self) -> float:
        """The root mean square in px of the part of the error that only the extended model
        explains; 0 if its error is larger.
        """
        return math.sqrt(max(0.0, self.base_px**2 - self.extended_px**2))


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """A partition of views into groups that are held out in turn."""

    group: NDArray[np.int64]
    """(V,) the group of each view, from 0."""
    pose: NDArray[np.int64]
    """(V,) the pose of the board in each view, from 0. The pictures of a burst share a pose; they
    are in the same group and count as one view.
    """


def fold_split(poses: Sequence[int] | NDArray[np.int64]) -> Split:
    """Return folds: every FOLDS-th pose of the board is in the same group."""
    pose = _consecutive(poses)
    return Split(pose % FOLDS, pose)


def depth_split(depths: Array, poses: Sequence[int] | NDArray[np.int64]) -> Split | None:
    """Return bands of near, middle and far poses of equal size; None if all have similar depths.

    Args:
        depths: (V,) m.
        poses: (V,) labels of the board's poses.
    """
    pose = _consecutive(poses)
    depth = np.bincount(pose, depths) / np.bincount(pose)
    band = depth.argsort().argsort() * DEPTH_BANDS // len(depth)
    nearest = np.median(depth[band == 0])
    farthest = np.median(depth[band == DEPTH_BANDS - 1])
    return Split(band[pose], pose) if farthest > MIN_DEPTH_RATIO * nearest else None


def _consecutive(labels: Sequence[int] | NDArray[np.int64]) -> NDArray[np.int64]:
    return np.unique(labels, return_inverse=True)[1].astype(np.int64)


def hold_out(
    model: CameraModel,
    observations: Observations,
    fit: JointFit,
    split: Split,
    *,
    half: bool = False,
) -> HeldOutErrors:
    """Fit without each group of views, and score that group.

    Args:
        fit: the fit to all views; the other fits start there, with its noise and prior.
        half: fit the own parameters of a held-out view to every other corner and score the
            remaining corners, as parameters of single views require.
    """
    scored = torch.ones(len(observations.pixels), dtype=torch.bool)
    group = torch.from_numpy(split.group)[observations.view]
    if half:
        for index in range(int(group.max()) + 1):
            scored[(group == index).nonzero()[::2]] = False
    residual = torch.full((len(scored), 2), torch.nan, dtype=torch.float64)
    weight = torch.zeros(len(scored), dtype=torch.float64)
    fitted = FittedModel(model, observations, fit)
    for index, held_out in enumerate(
        fits_without(fitted, fit.cost, split.group, ~scored if half else None)
    ):
        rows = group == index
        residual[rows] = torch.where(scored[rows, None], held_out.residual, torch.nan)
        weight[rows] = 1 / (1 + held_out.prediction_variance)
    pose = split.pose[observations.view.numpy()]
    return HeldOutErrors(residual.numpy(), pose, weight.numpy(), half)


def held_out_gain(base: HeldOutErrors, extended: HeldOutErrors) -> HeldOutGain:
    """Compare two models on the same views.

    The interval is from a bootstrap over views. The test flips the signs of the views' gains, which
    are losses equally often if the models are alike. A corner weighs less if the base fit predicts
    it less precisely.
    """
    base_squares = base.by_view(base.limit, base.weight)
    extended_squares = extended.by_view(base.limit, base.weight)
    count = len(base_squares)
    draws = np.random.default_rng(0).integers(0, count, (BOOTSTRAP_DRAWS, count))
    base_rms = np.sqrt(base_squares[draws].mean(1))
    extended_rms = np.sqrt(extended_squares[draws].mean(1))
    low, high = np.quantile(base_rms - extended_rms, [0.025, 0.975])
    presence = 1.0 if extended.half else sign_flip_p_value(_agreement(base, extended))
    return HeldOutGain(
        base_px=float(np.sqrt(base_squares.mean())),
        extended_px=float(np.sqrt(extended_squares.mean())),
        ci95=(float(low), float(high)),
        p_value=gain_p_value(base_squares, extended_squares),
        presence_p_value=presence,
    )


def _agreement(base: HeldOutErrors, extended: HeldOutErrors) -> Array:
    """Return (V,) px^2, the products of the base residual with the part of it that the extended
    model removes, summed over the corners that are no outliers.

    Both models fit a view's pose to all of its corners, so the base residual is the view's own
    noise, and the removed part is a prediction by independent views. Without the effect, the
    products are negative as often as positive.
    """
    # The limit does not depend on the extended model: where the two disagree, it is larger.
    inliers = (base.squares < base.limit) & np.isfinite(extended.squares)
    residual = base.residual[inliers]
    removed = residual - extended.residual[inliers]
    products = base.weight[inliers] * (residual * removed).sum(1)
    views = base.view.max() + 1
    return np.asarray(np.bincount(base.view[inliers], products, views), np.float64)
