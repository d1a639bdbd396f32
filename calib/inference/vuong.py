"""Vuong's test of two fits: does the difference of their likelihoods exceed the scatter of the
views?

Source: Q. H. Vuong, Likelihood ratio tests for model selection and non-nested hypotheses (1989).
    Neither model need be true.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from calib.estimation.objective import HUBER, view_precision
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.inference.fitted_model import ModelFit


def vuong_statistic(
    better: ModelFit, worse: ModelFit, difference: float, observations: Observations
) -> float:
    """Return the difference of two log evidences in standard deviations of the views' scatter.

    Args:
        difference: the log evidence of the better fit minus that of the worse one.
    """
    ratios = _view_log_likelihoods(better, observations)
    ratios = ratios - _view_log_likelihoods(worse, observations)
    return float(difference / (ratios.std(ddof=1) * len(ratios) ** 0.5))


def prior_difference(better: ModelFit, worse: ModelFit) -> float:
    """Return the part of the difference of two log evidences that comes from the priors of the
    views' own numbers, such as the motion of each board. Vuong's scatter does not have it.
    """
    return _log_view_priors(better) - _log_view_priors(worse)


def _log_view_priors(fit: ModelFit) -> float:
    """Return the logarithm of the prior density of the views' own numbers, up to a constant."""
    poses = fit.joint.poses
    return -float((poses**2 @ view_precision(fit.model.path, poses)).sum()) / 2


def _view_log_likelihoods(fit: ModelFit, observations: Observations) -> NDArray[np.float64]:
    """Return (V,) log likelihoods of the views' corners with Huber's loss, up to a constant for
    each view.
    """
    joint = fit.joint
    image = residuals(fit.model.path, joint.values, observations, joint.poses).image
    size = image.nan_to_num(0.0).norm(dim=-1) * observations.weight / joint.sigma
    huber = torch.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2)
    loss = huber / 2 + 2 * np.log(joint.sigma)
    return -np.array([float(view_loss.sum()) for view_loss in observations.per_view(loss)])
