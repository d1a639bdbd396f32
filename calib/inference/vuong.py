"""How the views agree that one fit is more probable than another.

Source: Q. H. Vuong, Likelihood ratio tests for model selection and non-nested hypotheses (1989):
    neither model need be right.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray

from calib.estimation.objective import HUBER
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.inference.score_test import ModelFit


def agreement(better: ModelFit, worse: ModelFit, apart: float, observations: Observations) -> float:
    """By how much one fit is more probable, the logarithm, over how much the views differ about it:
    in standard deviations.
    """
    each = _by_view(better, observations) - _by_view(worse, observations)
    return float(apart / (each.std(ddof=1) * len(each) ** 0.5))


def _by_view(fit: ModelFit, observations: Observations) -> NDArray[np.float64]:
    """(V,) the logarithm of the probability of each view's corners, up to a constant of the view,
    with Huber's loss.
    """
    model, joint = fit.model, fit.joint
    missed = residuals(model.path, joint.values, observations, joint.poses).image.nan_to_num(0.0)
    size = missed.norm(dim=-1) * observations.weight / joint.sigma
    loss = torch.where(size <= HUBER, size**2, 2 * HUBER * size - HUBER**2) / 2 + 2 * np.log(
        joint.sigma
    )
    return -np.array([float(view.sum()) for view in observations.per_view(loss)])
