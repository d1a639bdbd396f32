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
    exact model the expected scatter is 1, however many parameters a view determines. A. C. Cameron,
    J. B. Gelbach, D. L. Miller, Robust inference with multiway clustering (2011), for views and
    corners of the board together.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import torch
from numpy.typing import NDArray

from calib.estimation.joint_fit import Estimate
from calib.estimation.observations import Observations
from calib.estimation.view_equations import ReducedView, ViewEquations
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
class WhitenedRows:
    """The linearised residuals of the corners of one pose of the board, px over sigma, x and y of
    one corner after the other, with the pose eliminated.
    """

    jacobian: Array
    """(2m, S) derivatives by independent parameters of unit variance."""
    residual: Array
    """(2m,)"""
    corners: NDArray[np.int64] | None = None
    """(m,) the corner of the board of each pair of rows; None to count no corners."""

    def principal(self) -> tuple[Array, Array, Array]:
        """Return the leverages (k,) along orthogonal directions, the residual's pulls (k,) there,
        and the directions (S, k).
        """
        rows, size = self.jacobian.shape
        if size <= rows:
            shares, axes = np.linalg.eigh(self.jacobian.T @ self.jacobian)
            return shares.clip(0), axes.T @ (self.jacobian.T @ self.residual), axes
        shares, axes = np.linalg.eigh(self.jacobian @ self.jacobian.T)
        length = np.sqrt(shares.clip(1e-300))
        return shares.clip(0), length * (axes.T @ self.residual), self.jacobian.T @ (axes / length)


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
    def of(
        fitted: FittedModel,
        labels: NDArray[np.int64],
        views: Iterable[ReducedView] | None = None,
    ) -> ViewScatter:
        """Estimate the scatter at the optimum of a fit.

        Args:
            fitted: a model at its optimum.
            labels: (V,) labels of the board's poses: pictures of one pose count as one view.
            views: its reduced equations, perhaps with further effects; None to compute them.
        """
        count = fitted.parameters().count
        if not count or len(np.unique(labels)) < MIN_VIEWS or not fitted.joint.finite:
            return ViewScatter(1.0, 1.0, 1.0, np.zeros(0), np.zeros((count, count)))
        root = np.linalg.cholesky(fitted.joint.covariance.numpy())
        if views is None:
            views = map(ViewEquations.reduce, fitted.equations())
        return ViewScatter.of_groups(_pose_rows(fitted.observations, views, labels, root), root)

    @staticmethod
    def of_groups(groups: Iterable[WhitenedRows], root: Array, draws: int = 0) -> ViewScatter:
        """Estimate the scatter of independent groups of rows, one for each pose of the board.

        Args:
            groups: the rows of each group.
            root: (S, S) R with R R^T the covariance of the parameters.
            draws: the number of draws of the groups' scores from noise alone, which show by how
                much so few groups scatter by chance where some tell far more than others; 0 for
                the law of groups that all tell alike.
        """
        rng = np.random.default_rng(0)
        size = len(root)
        expected = np.zeros((size, size))  # the sum of the leverages of all groups
        corner_scores: dict[int, Array] = {}
        corrected, noise, traces = [], [], []
        squares = 0.0
        for rows in groups:
            expected += rows.jacobian.T @ rows.jacobian
            shares, pulls, axes = rows.principal()
            # HC2: the expected square of a pull is its leverage.
            pulls = pulls / np.sqrt(1 - shares.clip(0, MAX_LEVERAGE))
            squares += float((pulls**2).sum())
            corrected.append(axes @ pulls)
            traces.append(shares.sum())
            noise.append((rng.standard_normal((draws, len(shares))) * np.sqrt(shares)) @ axes.T)
            if rows.corners is not None:
                scores = (rows.jacobian * rows.residual[:, None]).reshape(-1, 2, size).sum(1)
                for corner, score in zip(rows.corners.tolist(), scores, strict=True):
                    corner_scores[corner] = corner_scores.get(corner, 0.0) + score
        determined = max(float(np.trace(expected)), 1e-300)  # the directions that corners determine
        sizes, directions = np.linalg.eigh(expected)
        is_told = sizes > MIN_SHARE
        whitening = directions[:, is_told] / np.sqrt(sizes[is_told])
        ratio = float(np.sqrt(squares / determined))
        drawn = np.array(noise).swapaxes(0, 1) @ whitening
        chance = max(
            (float(np.linalg.eigvalsh(sample.T @ sample)[-1]) for sample in drawn), default=0.0
        )
        scatter = _excess(np.array(corrected) @ whitening, ratio, chance)
        corner_ratio = 1.0
        if corner_scores:  # a corner of the board has little leverage: many views see it
            scores = np.array(list(corner_scores.values()))
            corner_ratio = float(np.sqrt((scores**2).sum() / determined))
            scatter = scatter + _excess(scores @ whitening, corner_ratio)
        inflation = float(np.sqrt(1 + np.trace(scatter) / max(len(scatter), 1)))
        half = root @ (directions[:, is_told] * np.sqrt(sizes[is_told]))
        portions = np.array(traces) / determined
        return ViewScatter(ratio, corner_ratio, inflation, portions, half @ scatter @ half.T)

    def widen(self, estimate: E) -> E:
        """Return the estimate with the covariance of views that scatter like this."""
        return replace(estimate, covariance=estimate.covariance + torch.from_numpy(self.excess))


def _pose_rows(
    observations: Observations,
    views: Iterable[ReducedView],
    labels: NDArray[np.int64],
    root: Array,
) -> Iterator[WhitenedRows]:
    """Yield the rows of each pose of the board, in the order of the labels."""
    points, corners = np.unique(observations.corners.numpy(), axis=0, return_inverse=True)
    repeats = 2 * len(points) <= len(corners)  # targets of points have others in each view
    starts = observations.starts.tolist()
    bursts: dict[int, list[WhitenedRows]] = {}
    has_bursts = len(np.unique(labels)) < len(labels)
    for view, reduced in enumerate(views):
        of_view = corners[starts[view] : starts[view + 1]] if repeats else None
        jacobian = reduced.jacobian[:, : len(root)]
        rows = WhitenedRows(jacobian @ root, reduced.residual, of_view)
        if not has_bursts:
            yield rows
        else:
            bursts.setdefault(int(labels[view]), []).append(rows)
    for _, burst in sorted(bursts.items()):
        yield WhitenedRows(
            np.concatenate([rows.jacobian for rows in burst]),
            np.concatenate([rows.residual for rows in burst]),
            np.concatenate([rows.corners for rows in burst]) if repeats else None,
        )


def _excess(pulls: Array, ratio: float, chance: float = 0.0) -> Array:
    """Return the (S, S) scatter of clusters of corners beyond that of independent corners.

    Args:
        pulls: (C, S) the clusters' scores where that of independent corners is the unit matrix.
        ratio: the root mean square of the clusters' scores over that of independent corners.
        chance: the largest scatter of noise alone that was drawn.
    """
    variances, axes = np.linalg.eigh(pulls.T @ pulls)
    share = pulls.shape[1] / len(pulls)
    true = _true_scatter(variances, share, max(1.0, ratio**2), chance)
    return np.asarray((axes * (true - 1.0)) @ axes.T)


def _true_scatter(scatter: Array, share: float, level: float, chance: float = 0.0) -> Array:
    """Return the (S,) true scatter along the directions in which few views scatter by so much, all
    over that of independent corners.

    Views that scatter by `level` in all directions alike seem to scatter by up to
    (1 + sqrt(share))^2 of it in some. A direction with more scatters more, by the size that is seen
    as so much.

    Args:
        scatter: (S,) the eigenvalues of the scatter.
        share: the number of directions over that of the views.
        chance: the largest scatter of noise alone that was drawn.
    """
    ratios = scatter / level
    edge = max((1 + np.sqrt(share)) ** 2, chance)
    half = (np.maximum(ratios, edge) + 1 - share) / 2
    spike = half + np.sqrt(np.maximum(half**2 - np.maximum(ratios, edge), 0.0))
    return np.asarray(level * np.where(ratios > edge, spike, 1.0))
