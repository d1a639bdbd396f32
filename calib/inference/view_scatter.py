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

from collections.abc import Iterable
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
class WhitenedRows:
    """The linearised residuals of some corners, px over sigma."""

    jacobian: Array
    """(n, S) derivatives by independent parameters of unit variance."""
    residual: Array
    """(n,)"""


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
        root = np.linalg.cholesky(fitted.joint.covariance.numpy())
        rows: dict[int, list[tuple[Array, Array]]] = {}
        for label, equations in zip(labels.tolist(), fitted.equations(), strict=True):
            view = equations.reduce()
            rows.setdefault(label, []).append((view.jacobian @ root, view.residual))
        groups = (
            WhitenedRows(
                np.concatenate([jacobian for jacobian, _ in views]),
                np.concatenate([residual for _, residual in views]),
            )
            for views in rows.values()
        )
        return ViewScatter.of_groups(groups, root)

    @staticmethod
    def of_groups(groups: Iterable[WhitenedRows], root: Array, draws: int = 0) -> ViewScatter:
        """Estimate the scatter of independent groups of rows, one for each pose of the board.

        Args:
            groups: the rows of each group, with the group's own parameters eliminated.
            root: (S, S) R with R R^T the covariance of the parameters.
            draws: the number of draws of the groups' scores from noise alone, which show by how
                much so few groups scatter by chance where some tell far more than others; 0 for
                the law of groups that all tell alike.
        """
        rng = np.random.default_rng(0)
        size = len(root)
        expected = np.zeros((size, size))  # the sum of the leverages of all groups
        corrected_squares = np.zeros((size, size))
        squares = 0.0
        count = 0
        noise: list[Array] = []  # (draws, S) scores of each group from noise alone
        for rows in groups:
            expected += rows.jacobian.T @ rows.jacobian
            shares, axes = np.linalg.eigh(rows.jacobian @ rows.jacobian.T)
            # HC2: the expected square is the leverage.
            whitened = axes.T @ rows.residual / np.sqrt(1 - shares.clip(0, MAX_LEVERAGE))
            squares += float(shares.clip(0) @ whitened**2)
            corrected = rows.jacobian.T @ (axes @ whitened)
            corrected_squares += np.outer(corrected, corrected)
            noise.append(rng.standard_normal((draws, len(rows.residual))) @ rows.jacobian)
            count += 1
        determined = np.trace(expected)  # the number of directions that the corners determine
        ratio = float(np.sqrt(squares / max(determined, 1e-300)))
        sizes, directions = np.linalg.eigh(expected)
        half = directions * np.sqrt(sizes.clip(1e-12))  # (S, S), half half^T = expected
        to_white = directions / np.sqrt(sizes.clip(1e-12))
        scatter, axes = np.linalg.eigh(to_white.T @ corrected_squares @ to_white)
        chance = max(
            (_largest(np.array(noise)[:, draw] @ to_white) for draw in range(draws)), default=0.0
        )
        true = _true_scatter(scatter, determined / count, max(1.0, ratio**2), chance)
        spread = root @ half @ (axes * np.sqrt(true - 1.0))
        return ViewScatter(ratio, np.asarray(spread @ spread.T))

    def widen(self, estimate: E) -> E:
        """Return the estimate with the covariance of views that scatter like this."""
        return replace(estimate, covariance=estimate.covariance + torch.from_numpy(self.excess))


def _largest(scores: Array) -> float:
    """Return the largest eigenvalue of the sum of squares of (G, S) scores."""
    return float(np.linalg.eigvalsh(scores @ scores.T)[-1])


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
    seen = scatter / level
    edge = max((1 + np.sqrt(share)) ** 2, chance)
    half = (np.maximum(seen, edge) + 1 - share) / 2
    spike = half + np.sqrt(np.maximum(half**2 - np.maximum(seen, edge), 0.0))
    return np.asarray(level * np.where(seen > edge, spike, 1.0))
