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
    One ratio stands for all directions but those in which the views scatter by more than chance
    lets so few views scatter. With as many parameters as views, as behind uneven glass, these are
    few.
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
        corrected = np.einsum("vij,vj->vi", bases, pulls / np.sqrt(remainder))
        sizes, directions = np.linalg.eigh(expected)
        half = directions * np.sqrt(sizes.clip(1e-12))  # (S, S), half half^T = expected
        whitened = corrected @ (directions / np.sqrt(sizes.clip(1e-12)))
        scatter, axes = np.linalg.eigh(whitened.T @ whitened)
        count = len(np.unique(labels))
        true = _true_scatter(scatter, determined / count, max(1.0, ratio**2))
        spread = root @ half @ (axes * np.sqrt(true - 1.0))
        return ViewScatter(ratio, np.asarray(spread @ spread.T))

    def widen(self, estimate: E) -> E:
        """Return the estimate with the covariance of views that scatter like this."""
        return replace(estimate, covariance=estimate.covariance + torch.from_numpy(self.excess))


def _true_scatter(scatter: Array, share: float, level: float) -> Array:
    """Return the (S,) true scatter along the directions in which few views scatter by so much, all
    over that of independent corners.

    Views that scatter by `level` in all directions alike seem to scatter by up to
    (1 + sqrt(share))^2 of it in some. A direction with more scatters more, by the size that is seen
    as so much.

    Args:
        scatter: (S,) the eigenvalues of the scatter.
        share: the number of directions over that of the views.
    """
    seen = scatter / level
    edge = (1 + np.sqrt(share)) ** 2
    half = (np.maximum(seen, edge) + 1 - share) / 2
    spike = half + np.sqrt(np.maximum(half**2 - np.maximum(seen, edge), 0.0))
    return np.asarray(level * np.where(seen > edge, spike, 1.0))
