"""The error of explanations on placements that they were not fitted to.

Placements are held out in groups. The rig's numbers, and those of an explanation that all
placements share, come from the others. Of a held-out placement, its pose and the motions that
belong to it alone are fitted to every other corner, and the remaining corners are scored; then the
other way round.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from calib.inference.cross_validation import BOOTSTRAP_DRAWS, FOLDS, HeldOutGain
from calib.inference.sign_flip_test import gain_p_value
from calib.rig.explanation_fit import FittedExplanation
from calib.rig.motion_evidence import RandomMotion, ReducedMotions
from calib.rig.rig_context import RigContext

MIN_SHARED = 2 * FOLDS
"""The fewest placements that two cameras saw, with which an effect can be confirmed."""

Array = NDArray[np.float64]


def held_out_squares(context: RigContext, fitted: FittedExplanation, noise_px: float) -> Array:
    """Return the (P,) px^2 mean squares of the corners of each held-out placement; NaN for one that
    a single camera saw.

    Args:
        noise_px: the noise of a corner, px per axis, over which the products are.
    """
    products = context.products
    random = (*context.accepted, *fitted.random, *fitted.discrepancy)
    adapting = [motion for motion in random if motion.adapts]
    groups = np.empty(context.count, np.int64)
    groups[context.order] = np.arange(context.count) % FOLDS
    corners = np.sum(list(products.corners.values()), 0)
    squares = np.full(context.count, np.nan)
    for group in range(FOLDS):
        reduced = ReducedMotions.of(products, random, groups != group)
        motion = fitted.fixed
        value = reduced.estimate(motion).value if motion else None
        point = np.zeros(products.products.shape[1])
        point[products.numbers] = reduced.step(motion, value)
        point[-1] = 1.0
        for place in np.flatnonzero((groups == group) & context.shared):
            moved = point.copy()
            if motion and value is not None:
                moved[motion.columns] += motion.by_number[place] @ value
            squares[place] = noise_px**2 * _score(context, moved, adapting, int(place))
    return np.asarray(squares / corners)


def placement_gain(base: Array, extended: Array) -> HeldOutGain:
    """Compare two models by the (P,) px^2 of `held_out_squares`."""
    scored = np.isfinite(base) & np.isfinite(extended)
    base, extended = base[scored], extended[scored]
    draws = np.random.default_rng(0).integers(0, len(base), (BOOTSTRAP_DRAWS, len(base)))
    gains = np.sqrt(base[draws].mean(1)) - np.sqrt(extended[draws].mean(1))
    low, high = np.quantile(gains, [0.025, 0.975])
    return HeldOutGain(
        base_px=float(np.sqrt(base.mean())),
        extended_px=float(np.sqrt(extended.mean())),
        ci95=(float(low), float(high)),
        p_value=gain_p_value(base, extended),
        presence_p_value=1.0,
    )


def _score(
    context: RigContext, point: Array, adapting: Sequence[RandomMotion], place: int
) -> float:
    """Return the sum of the squares of a placement's corners, each half scored with the pose and
    the motions of the other half.
    """
    total = 0.0
    products = context.products
    fitted_size = len(products.block_precision)
    columns = np.r_[products.placement, *(motion.columns for motion in adapting)]
    roots = [motion.root[place] for motion in adapting]
    root = block_diag(np.eye(fitted_size), *roots)
    prior = np.ones(len(root))
    prior[:fitted_size] = products.block_precision
    pull = np.zeros(len(root))
    pull[:fitted_size] = products.block_precision * products.blocks[place]
    for half in (0, 1):
        fitted = products.halves[half, place]
        scored = products.halves[1 - half, place]
        rows = root.T @ fitted[columns]
        hessian = rows[:, columns] @ root + np.diag(prior)
        moved = point.copy()
        moved[columns] -= root @ np.linalg.solve(hessian, rows @ point + pull)
        total += float(moved @ scored @ moved)
    return total
