"""The scatter of the views about a fit, and standard deviations that count views, not corners.

The corners of one view share what the model lacks: a board that flexed, a focus that moved, a print
that is not even. Their errors are not independent, and a covariance that counts them as such is too
small: on twelve measured sets, fits of two halves of the views differ by three to five of its
standard deviations. The scores of whole views tell by how much they scatter.

Sources: H. White, Maximum likelihood estimation of misspecified models (1982), for the covariance
    under a model that is not exact; R. M. Bell, D. F. McCaffrey, Bias reduction in standard errors
    for linear regression with multi-stage samples (2002), for a view's leverage (HC2): under an
    exact model the expected scatter is 1, however many parameters a view determines.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from calib.estimation.joint_fit import Estimate
from calib.inference.fitted_model import FittedModel

MAX_LEVERAGE = 0.9
"""The largest leverage of a view along a direction that is corrected in full: a view that holds
nearly all that is known there has no residual there.
"""
MIN_VIEWS = 4
"""The fewest poses of the board from which the scatter is estimated."""

E = TypeVar("E", bound=Estimate)


def view_scatter(fitted: FittedModel, labels: NDArray[np.int64]) -> float:
    """Return the root mean square of the views' scores over that of independent corners with the
    fit's noise, at least 1. Noise alone gives about 1.

    Args:
        fitted: a model at its optimum.
        labels: (V,) labels of the board's poses: pictures of one pose count as one view.
    """
    count = fitted.parameters().count
    if not count or len(np.unique(labels)) < MIN_VIEWS or not fitted.joint.finite:
        return 1.0
    information = np.zeros((labels.max() + 1, count, count))
    scores = np.zeros((labels.max() + 1, count))
    for label, equations in zip(labels.tolist(), fitted.equations(), strict=True):
        view = equations.reduce()
        information[label] += view.information
        scores[label] += view.jacobian.T @ view.residual
    root = np.linalg.cholesky(fitted.joint.covariance.numpy())
    squares = 0.0
    for view_information, score in zip(information, scores, strict=True):
        leverage, directions = np.linalg.eigh(root.T @ view_information @ root)
        weight = 1 - leverage.clip(0, MAX_LEVERAGE)
        squares += float(((directions.T @ (root.T @ score)) ** 2 / weight).sum())
    freedom = float(np.einsum("vij,ji->", information, root @ root.T))
    return float(max(1.0, (squares / max(freedom, 1e-300)) ** 0.5))


def count_views(estimate: E, fitted: FittedModel, scatter: float) -> E:
    """Return the estimate with the covariance of views that scatter: the information of the corners
    is worth less by the square of the scatter, that of the prior is not.

    Args:
        estimate: the estimate of the fitted model.
        fitted: the model at its optimum.
        scatter: `view_scatter` of the fit.
    """
    prior = torch.from_numpy(fitted.prior_precision())
    covariance = estimate.covariance
    wider = scatter**2 * covariance + (1 - scatter**2) * covariance @ prior @ covariance
    return replace(estimate, covariance=(wider + wider.mT) / 2)
