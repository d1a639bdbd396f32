"""The scatter of the views about a fit, and standard deviations that count views, not corners.

The corners of one view share what the model lacks: a board that flexed, a focus that moved, a print
that is not even. Their errors are not independent, and a covariance that counts them as such is too
small: on twelve measured sets, fits of two halves of the views differ by three to five of its
standard deviations. The scores of whole views tell by how much they scatter. What all views share
is not seen there: an error of the print is in every view at the same corner of the board, and the
scores of the board's corners, each summed over all views, tell by how much these scatter.

Sources: H. White, Maximum likelihood estimation of misspecified models (1982), for the covariance
    under a model that is not exact; R. M. Bell, D. F. McCaffrey, Bias reduction in standard errors
    for linear regression with multi-stage samples (2002), for a view's leverage (HC2): under an
    exact model the expected scatter is 1, however many parameters a view determines. J. G.
    MacKinnon, H. White, Some heteroskedasticity-consistent covariance matrix estimators with
    improved finite sample properties (1985), for HC3; A. C. Cameron, J. B. Gelbach, D. L. Miller,
    Robust inference with multiway clustering (2011), for views and corners of the board together.
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
MIN_SHARE = 0.1
"""The part of the information on a direction that comes from the corners, from which its scatter
counts: the rest is the prior's, which does not scatter.
"""
MIN_VIEWS = 4
"""The fewest poses of the board from which the scatter is estimated."""

Array = NDArray[np.float64]
E = TypeVar("E", bound=Estimate)


@dataclass(frozen=True, slots=True, eq=False)
class ViewScatter:
    """The scatter of the views, and of the board's corners, about a fit.

    It differs between directions: a focal length that moves from view to view scatters in its own.
    One ratio stands for all directions but those in which the views scatter by more than chance
    lets so few views scatter. With as many parameters as views, as behind uneven glass, these are
    few.
    """

    ratio: float
    """The root mean square of the views' scores over that of independent corners with the fit's
    noise. Noise alone gives about 1.
    """
    corner_ratio: float
    """The same of the scores of the board's corners, each summed over all views: what the print
    of the board leaves.
    """
    inflation: float
    """The root mean square of the standard deviations over those of independent corners, over the
    directions that the corners determine.
    """
    shares: Array
    """(L,) the part of what all views tell that each pose of the board tells."""
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
            return ViewScatter(1.0, 1.0, 1.0, np.zeros(0), np.zeros((count, count)))
        views, corners, information = _scores(fitted, labels)
        root = np.linalg.cholesky(fitted.joint.covariance.numpy())
        leverages = root.T @ information @ root
        expected = leverages.sum(0)
        determined = float(np.trace(expected))  # the directions that the corners determine
        sizes, directions = np.linalg.eigh(expected)
        told = sizes > MIN_SHARE
        whitening = directions[:, told] / np.sqrt(sizes[told])

        shares, bases = np.linalg.eigh(leverages)  # (V, S), (V, S, S)
        remainder = 1 - shares.clip(0, MAX_LEVERAGE)
        pulls = np.einsum("vji,vj->vi", bases, views @ root)
        squares = (pulls**2 / remainder).sum()  # HC2: the expected square is the leverage
        ratio = float(np.sqrt(squares / max(determined, 1e-300)))
        corrected = np.einsum("vij,vj->vi", bases, pulls / np.sqrt(remainder)) @ whitening
        scatter = _excess(corrected, ratio)

        pulls = corners @ root  # a corner of the board has little leverage: many see it
        corner_ratio = float(np.sqrt((pulls**2).sum() / max(determined, 1e-300)))
        scatter += _excess(pulls @ whitening, corner_ratio)

        inflation = float(np.sqrt(1 + np.trace(scatter) / len(scatter)))
        half = root @ (directions[:, told] * np.sqrt(sizes[told]))
        view_shares = np.trace(leverages, axis1=1, axis2=2) / max(determined, 1e-300)
        return ViewScatter(ratio, corner_ratio, inflation, view_shares, half @ scatter @ half.T)

    def widen(self, estimate: E) -> E:
        """Return the estimate with the covariance of views that scatter like this."""
        return replace(estimate, covariance=estimate.covariance + torch.from_numpy(self.excess))


def _scores(fitted: FittedModel, labels: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Return the (L, S) scores of the poses of the board, the (K, S) scores of its corners, each
    summed over all views, and the (L, S, S) information of the poses.
    """
    count = fitted.parameters().count
    observations = fitted.observations
    _, corners = np.unique(observations.corners.numpy(), axis=0, return_inverse=True)
    starts = observations.starts.tolist()
    information = np.zeros((labels.max() + 1, count, count))
    view_scores = np.zeros((labels.max() + 1, count))
    corner_scores = np.zeros((corners.max() + 1, count))
    for view, equations in enumerate(fitted.equations()):
        reduced = equations.reduce()
        rows = reduced.jacobian * reduced.residual[:, None]
        information[labels[view]] += reduced.information
        view_scores[labels[view]] += rows.sum(0)
        of_view = corners[starts[view] : starts[view + 1]]
        np.add.at(corner_scores, of_view, rows.reshape(len(of_view), 2, count).sum(1))
    return view_scores, corner_scores, information


def _excess(pulls: Array, ratio: float) -> Array:
    """Return the (S, S) scatter of clusters of corners beyond that of independent corners.

    Args:
        pulls: (C, S) the clusters' scores where that of independent corners is the unit matrix.
        ratio: the root mean square of the clusters' scores over that of independent corners.
    """
    variances, axes = np.linalg.eigh(pulls.T @ pulls)
    share = pulls.shape[1] / len(pulls)
    true = _true_scatter(variances, share, max(1.0, ratio**2))
    return np.asarray((axes * (true - 1.0)) @ axes.T)


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
