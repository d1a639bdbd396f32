"""Rao's score test of every candidate effect, at the optimum of the fit without it.

A missing effect leaves a residual r along its own columns of the Jacobian. Let Q be an orthonormal
basis of these columns after the directions of the fitted parameters are projected out. Then chi^2 =
|Q^T r|^2 / sigma^2 measures the effect without a further fit.

Source: C. R. Rao, Large sample tests of statistical hypotheses concerning several parameters
    (1948).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import SupportsFloat

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc

from calib.effects.effect import Effect
from calib.estimation.orthogonal_projection import orthonormal_basis, project_out
from calib.estimation.view_equations import ViewEquations
from calib.inference.fitted_model import FittedModel
from calib.inference.jackknife import jackknife_p_value
from calib.optics.view_blocks import CENTRE, FOCAL, block_columns

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ScoreTest:
    """The score test of one candidate effect."""

    effect: Effect
    jacobian: Array
    """(2M, k) px over sigma, by each of its parameters over its scale, with the directions of the
    views' own and the fitted parameters projected out. (2M, 0) for parameters of single views.
    """
    raw: float
    """The sum of squares of the Jacobian with only the views' own parameters projected out."""
    chi2: float
    """The decrease of the sum of squares by the effect."""
    dof: int
    find_p_value: Callable[[], SupportsFloat]
    """Computes `p_value`, which takes longer than all the rest and is seldom asked."""
    cost: float
    """The sum of squares of the fit."""
    information: Array
    """(k, k) of its parameters, with the prior of the fitted parameters but not its own; (0, 0) for
    parameters of single views.
    """
    score: Array
    """(k,) half the gradient of the sum of squares by its parameters."""

    @cached_property
    def p_value(self) -> float:
        """The smaller p-value of two tests of whether the views agree, or, with few views for the
        number of parameters, that of chi2 over the dispersion of the residual.
        """
        return float(self.find_p_value())

    @property
    def promises(self) -> float:
        """The largest relative decrease of the root mean square error."""
        return 1.0 - float(np.sqrt(1.0 - min(1.0, self.chi2 / self.cost)))

    @property
    def absorbed(self) -> float:
        """The fraction of the effect that the fitted parameters can imitate, 0 to 1."""
        return 1.0 - float((self.jacobian**2).sum()) / self.raw if self.raw > 0 else 0.0

    def span(self) -> Array:
        """Return (2M, n) orthonormal directions in which only this effect moves corners."""
        return orthonormal_basis(self.jacobian)


def tuned_score_tests(fitted: FittedModel, effects: Sequence[Effect]) -> list[ScoreTest]:
    """Test effects, each without the others, with priors adapted to the residual."""
    tests = score_tests(fitted, effects)
    tuned = [test.effect.tune(test.information, test.score) for test in tests]
    changed = [new for new, test in zip(tuned, tests, strict=True) if new != test.effect]
    changed_tests = iter(score_tests(fitted, changed))
    return [
        test if new == test.effect else next(changed_tests)
        for new, test in zip(tuned, tests, strict=True)
    ]


def score_test(fitted: FittedModel, effect: Effect) -> ScoreTest:
    """Test one effect with its own prior."""
    return score_tests(fitted, (effect,))[0]


def score_tests(fitted: FittedModel, effects: Sequence[Effect]) -> list[ScoreTest]:
    """Test effects, each without the others, with their own priors.

    Effects without common parameters share a linearisation.
    """
    tests: dict[int, ScoreTest] = {}
    remaining = dict(enumerate(effects))
    while remaining:
        names: set[str] = set()
        batch: dict[int, Effect] = {}
        for index, effect in remaining.items():
            of_view = effect.per_view in (FOCAL, CENTRE)  # a view has one of the two
            taken = {effect.name, *(u.param.name for u in effect.effect_parameters)}
            taken |= {"camera_block"} if of_view else set()
            if not names & taken:
                names |= taken
                batch[index] = effect
        tests |= zip(batch, _test_batch(fitted, tuple(batch.values())), strict=True)
        remaining = {i: effect for i, effect in remaining.items() if i not in batch}
    return [tests[index] for index in range(len(effects))]


def _test_batch(fitted: FittedModel, effects: Sequence[Effect]) -> list[ScoreTest]:
    """Test effects without common parameters from one linearisation."""
    views = list(fitted.equations(effects))
    blocks = block_columns(fitted.model.with_effects(effects).path.view_blocks)
    own_columns = np.concatenate([np.r_[blocks[block]] for block in fitted.model.path.view_blocks])
    parameters = fitted.parameters(effects)
    reduced = _ReducedSystem.of(
        views,
        own_columns,
        fitted.parameters().count,
        fitted.prior_precision(effects),
        fitted.deviation,
        fitted.merged_squares,
    )
    tests = []
    for effect in effects:
        if effect.per_view:
            tests.append(
                _test_view_effect(
                    effect,
                    views,
                    own_columns,
                    blocks[effect.per_view],
                    fitted.freedom,
                    fitted.merged_squares,
                )
            )
        else:
            entries = parameters.entries(u.param.name for u in effect.effect_parameters)
            tests.append(reduced.test(effect, entries, fitted.freedom))
    return tests


def _test_view_effect(
    effect: Effect,
    views: Sequence[ViewEquations],
    own_columns: NDArray[np.int64],
    added: slice,
    freedom: int,
    merged_squares: float,
) -> ScoreTest:
    """Test an effect with parameters in every view.

    Args:
        own_columns: the columns of the views' own parameters in the fit.
        added: the columns of the effect.
        freedom: the degrees of freedom of the residual without the effect.
        merged_squares: those of `FittedModel`.
    """
    chi2 = 0.0
    squares = merged_squares
    dof = 0
    for view in views:
        fitted_columns = view.jacobian_block[:, own_columns]
        residual = project_out(fitted_columns, view.residual)
        directions = orthonormal_basis(project_out(fitted_columns, view.jacobian_block[:, added]))
        chi2 += float(((directions.T @ residual) ** 2).sum())
        squares += float((residual**2).sum())
        dof += directions.shape[1]
    freedom_with_effect = max(1, freedom - dof)
    dispersion = (squares - chi2) / freedom_with_effect
    return ScoreTest(
        effect=effect,
        jacobian=np.zeros((0, 0)),
        raw=0.0,
        chi2=chi2,
        dof=dof,
        find_p_value=partial(fdtrc, dof, freedom_with_effect, max(0.0, chi2 / dof / dispersion)),
        cost=squares,
        information=np.zeros((0, 0)),
        score=np.zeros(0),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _ReducedSystem:
    """The linearised equations of all views, with the views' own parameters eliminated."""

    view_residuals: list[Array]
    """(2m,) for each view."""
    residual: Array
    """(2M,) of all views."""
    jacobian: Array
    """(2M, S) by the fitted parameters, then those of the effects."""
    projected: Array
    """(2M, K) by the effects' parameters, with the fitted parameters eliminated."""
    imitation: Array
    """(F, K) the response of the fitted parameters to those of the effects."""
    gradient: Array
    """(F,) by the fitted parameters; zero at an exact optimum."""
    precision: Array
    """(S, S) prior precision."""
    merged_squares: float
    """That of `FittedModel`."""

    @staticmethod
    def of(
        views: Sequence[ViewEquations],
        own_columns: NDArray[np.int64],
        fitted: int,
        precision: Array,
        deviation: Array,
        merged_squares: float,
    ) -> _ReducedSystem:
        """Reduce the equations; the first `fitted` shared parameters are those of the fit."""
        reduced = [view.reduce(own_columns) for view in views]
        residual = np.concatenate([view.residual for view in reduced])
        jacobian = np.concatenate([view.jacobian for view in reduced])
        fitted_jacobian = jacobian[:, :fitted]
        prior = precision[:fitted, :fitted]
        imitation = np.linalg.solve(
            fitted_jacobian.T @ fitted_jacobian + prior, fitted_jacobian.T @ jacobian[:, fitted:]
        )
        return _ReducedSystem(
            view_residuals=[view.residual for view in reduced],
            residual=residual,
            jacobian=jacobian,
            projected=jacobian[:, fitted:] - fitted_jacobian @ imitation,
            imitation=imitation,
            gradient=fitted_jacobian.T @ residual + prior @ deviation,
            precision=precision,
            merged_squares=merged_squares,
        )

    def test(self, effect: Effect, entries: NDArray[np.int64], freedom: int) -> ScoreTest:
        """Test an effect.

        Args:
            entries: the columns of its parameters.
            freedom: the degrees of freedom of the residual.
        """
        fitted = len(self.gradient)
        effect_columns = self.jacobian[:, entries]
        projected = self.projected[:, entries - fitted]
        information = effect_columns.T @ projected
        # Without the gradient, an effect that the fitted parameters imitate would seem significant.
        imitated = self.imitation[:, entries - fitted].T @ self.gradient
        score = effect_columns.T @ self.residual - imitated
        hessian = information + self.precision[np.ix_(entries, entries)]
        cost = float(self.residual @ self.residual) + self.merged_squares
        chi2 = max(0.0, float(score @ np.linalg.solve(hessian, score)))
        find_p_value: Callable[[], SupportsFloat]
        if len(score) > len(self.view_residuals) // 3:
            dispersion = max(cost / max(1, freedom), 1e-12)
            find_p_value = partial(chdtrc, len(score), chi2 / dispersion)
        else:
            find_p_value = partial(
                _agreement_p_value, self.view_residuals, projected, score, hessian
            )
        return ScoreTest(
            effect=effect,
            jacobian=projected,
            raw=float((effect_columns**2).sum()),
            chi2=chi2,
            dof=len(score),
            find_p_value=find_p_value,
            cost=cost,
            information=information,
            score=score,
        )


def _agreement_p_value(
    residuals: Sequence[Array], projected: Array, score: Array, hessian: Array
) -> float:
    """Return the p-value of the agreement of the views, twice the smaller one of two tests.

    Args:
        residuals: (2m,) of each view.
        projected: (2M, k) by the effect's parameters, with the fitted parameters eliminated.
        score: (k,), of all views.
        hessian: (k, k), of all views.
    """
    jacobians = np.split(projected, np.cumsum([len(residual) for residual in residuals])[:-1])
    by_view = np.array(
        [
            (jacobian * residual[:, None]).sum(0)
            for jacobian, residual in zip(jacobians, residuals, strict=True)
        ]
    )
    by_view += (score - by_view.sum(0)) / len(by_view)  # the prior's share
    jackknife = jackknife_p_value(residuals, jacobians, score, hessian)
    return min(1.0, 2 * min(_hotelling_p_value(by_view), jackknife))


def _hotelling_p_value(by_view: Array) -> float:
    """Return the p-value of Hotelling's T^2 for (V, k) scores: do the views agree on a direction
    away from the neutral values?

    It is robust against views with bad corners, whose scatter is in its denominator.
    """
    views, dof = by_view.shape
    mean = by_view.mean(0)
    scatter = np.cov(by_view, rowvar=False).reshape(dof, dof)
    scale = np.sqrt(np.maximum(scatter.diagonal(), 1e-300))
    normalised = mean / scale
    correlation = np.linalg.pinv(scatter / np.outer(scale, scale), rcond=1e-10)
    t2 = views * float(normalised @ correlation @ normalised)
    return float(fdtrc(dof, views - dof, (views - dof) / (dof * (views - 1)) * max(0.0, t2)))
