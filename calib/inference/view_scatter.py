"""The scatter of the views about a fit, and standard deviations that count views, not corners.

The corners of one view share what the model lacks: a board that flexed, a focus that moved, a print
that is not even. Their errors are not independent, and a covariance that counts them as such is too
small: on twelve measured sets, fits of two halves of the views differ by three to five of its
standard deviations. The scores of whole views tell by how much they scatter.

Sources: H. White, Maximum likelihood estimation of misspecified models (1982), for the covariance
    under a model that is not exact; R. M. Bell, D. F. McCaffrey, Bias reduction in standard errors
    for linear regression with multi-stage samples (2002), for a view's leverage (HC2): under an
    exact model the expected scatter is 1, however many parameters a view determines. J. G.
    MacKinnon, H. White, Some heteroskedasticity-consistent covariance matrix estimators with
    improved finite sample properties (1985), for HC3.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
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

Array = NDArray[np.float64]
E = TypeVar("E", bound=Estimate)


@dataclass(frozen=True, slots=True, eq=False)
class ViewScatter:
    """The scatter of the views about a fit.

    It differs between directions: a focal length that moves from view to view scatters in its own.
    Few views show this for few parameters only. With as many parameters as views, as behind uneven
    glass, one ratio stands for all directions.
    """

    ratio: float
    """The root mean square of the views' scores over that of independent corners with the fit's
    noise. Noise alone gives about 1.
    """
    excess: Array
    """(S, S) covariance of the parameters' vector beyond that of independent corners; it is
    positive semidefinite.
    """

    @staticmethod
    def of(fitted: FittedModel, labels: NDArray[np.int64]) -> ViewScatter:
        """Estimate the scatter at the optimum of a fit.

        Args:
            fitted: a model at its optimum.
            labels: (V,) labels of the board's poses: pictures of one pose count as one view.
        """
        count = fitted.parameters().count
        if not count or len(np.unique(labels)) < MIN_VIEWS or not fitted.joint.finite:
            return ViewScatter(1.0, np.zeros((count, count)))
        information = np.zeros((labels.max() + 1, count, count))
        scores = np.zeros((labels.max() + 1, count))
        for label, equations in zip(labels.tolist(), fitted.equations(), strict=True):
            view = equations.reduce()
            information[label] += view.information
            scores[label] += view.jacobian.T @ view.residual
        root = np.linalg.cholesky(fitted.joint.covariance.numpy())
        leverages = root.T @ information @ root
        expected = leverages.sum(0)
        determined = np.trace(expected)  # the number of directions that the corners determine
        shares, bases = np.linalg.eigh(leverages)  # (V, S), (V, S, S)
        remainder = 1 - shares.clip(0, MAX_LEVERAGE)
        pulls = np.einsum("vji,vj->vi", bases, scores @ root)
        squares = (pulls**2 / remainder).sum()  # HC2: the expected square is the leverage
        ratio = float(np.sqrt(squares / max(determined, 1e-300)))
        weight = min(1.0, determined / len(np.unique(labels)))
        scatter = weight * ratio**2 * expected
        if weight < 1:
            # HC3: each score as a fit without that view would leave it
            without = np.einsum("vij,vj->vi", bases, pulls / remainder)
            scatter = scatter + (1 - weight) * without.T @ without
        sizes, directions = np.linalg.eigh(scatter - expected)
        spread = root @ (directions * np.sqrt(sizes.clip(0)))
        return ViewScatter(ratio, np.asarray(spread @ spread.T))

    def widen(self, estimate: E) -> E:
        """Return the estimate with the covariance of views that scatter like this."""
        return replace(estimate, covariance=estimate.covariance + torch.from_numpy(self.excess))
