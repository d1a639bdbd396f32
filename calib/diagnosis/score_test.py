"""Rao's score test of every candidate effect, at the optimum of the fit without it.

An effect that is missing leaves a residual r along its own columns of the Jacobian: with Q an
orthonormal basis of these columns, all that the fitted parameters can do projected out, chi^2 =
|Q^T r|^2 / sigma^2 says how much, and nothing is fitted again.

Source: C. R. Rao, Large sample tests of statistical hypotheses concerning several parameters
    (1948).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc

from calib.diagnosis.jackknife import jackknife
from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.elimination import (
    ViewEquations,
    information,
    orthonormal_basis,
    project_out,
    view_equations,
)
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.optics.board_target import block_columns

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class ScoreTest:
    """What one candidate effect would explain of the residual."""

    effect: Effect
    jacobian: Array
    """(2M, k) px over sigma, by each of its parameters over its scale; what the views' own and the
    fitted parameters can do is projected out. (2M, 0) for parameters of views.
    """
    raw: float
    """Sum of squares of the same with only the views' own parameters projected out."""
    chi2: float
    """By how much its parameters would lower the sum of squares."""
    dof: int
    p_value: float
    """From how the views agree, if there are enough of them for its parameters, by the better of
    two tests; else from chi2 over the residual's dispersion.
    """

    cost: float
    """The fit's sum of squares."""
    information: Array
    """(k, k) on its parameters, with the prior of the fitted ones but not of its own; (0, 0) for
    parameters of views.
    """
    score: Array
    """(k,) of its parameters: minus half the gradient of the sum of squares."""

    @property
    def promises(self) -> float:
        """The fraction by which it would lower the root mean square at best."""
        return 1.0 - float(np.sqrt(1.0 - min(1.0, self.chi2 / self.cost)))

    @property
    def absorbed(self) -> float:
        """The fraction of the effect that the fitted parameters can imitate, 0 to 1."""
        return 1.0 - float((self.jacobian**2).sum()) / self.raw if self.raw > 0 else 0.0

    def span(self) -> Array:
        """(2M, n) orthonormal: the directions in which it moves corners and nothing else does."""
        return orthonormal_basis(self.jacobian)


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """A fit where it ended."""

    model: CameraModel
    observations: Observations
    joint: JointFit

    def candidates(self, effects: Sequence[Effect]) -> list[ScoreTest]:
        """The scores of effects, each without the others, with the priors that suit the
        residual.
        """
        found = self.tests(effects)
        tuned = [test.effect.tune(test.information, test.score) for test in found]
        again = iter(
            self.tests([new for new, test in zip(tuned, found, strict=True) if new != test.effect])
        )
        return [
            test if new == test.effect else next(again)
            for new, test in zip(tuned, found, strict=True)
        ]

    def test(self, effect: Effect) -> ScoreTest:
        """The score of one effect as it is."""
        return self.tests((effect,))[0]

    def tests(self, effects: Sequence[Effect]) -> list[ScoreTest]:
        """The scores of effects as they are, each without the others, from one linearisation of all
        that have no parameter in common.
        """
        found: dict[int, ScoreTest] = {}
        waiting = dict(enumerate(effects))
        while waiting:
            names: set[str] = set()
            together: dict[int, Effect] = {}
            for index, effect in waiting.items():
                own = {effect.name, *(unknown.param.name for unknown in effect.effect_parameters)}
                if not names & own:
                    names |= own
                    together[index] = effect
            found |= zip(together, self._tests(tuple(together.values())), strict=True)
            waiting = {index: effect for index, effect in waiting.items() if index not in together}
        return [found[index] for index in range(len(effects))]

    def _tests(self, effects: Sequence[Effect]) -> list[ScoreTest]:
        views = list(self.equations(effects))
        place = block_columns(self.model.with_effects(effects).path.view_blocks)
        own = np.concatenate([np.r_[place[part]] for part in self.model.path.view_blocks])
        residual = [project_out(view.jacobian_block[:, own], view.residual) for view in views]
        off = np.concatenate(residual)  # (2M,)
        rows = np.concatenate(
            [project_out(view.jacobian_block[:, own], view.jacobian_shared) for view in views]
        )
        fitted, parameters = self.parameters().count, self.parameters(effects)
        known, precision = rows[:, :fitted], self.prior_precision(effects)
        imitated = np.linalg.solve(
            known.T @ known + precision[:fitted, :fitted], known.T @ rows[:, fitted:]
        )
        left = rows[:, fitted:] - known @ imitated
        starts = np.cumsum([len(view) for view in residual])[:-1]
        unfinished = (
            known.T @ off + precision[:fitted, :fitted] @ self.deviation
        )  # zero where the fit ended exactly at its optimum
        dispersion = float(off @ off) / max(1, self._freedom())

        def scored(effect: Effect) -> ScoreTest:
            if effect.per_view:
                return self._of_views(effect, views, own, place[effect.per_view])
            entries = parameters.entries(unknown.param.name for unknown in effect.effect_parameters)
            new, unlike = rows[:, entries], left[:, entries - fitted]
            information = new.T @ unlike
            score = (
                new.T @ off - imitated[:, entries - fitted].T @ unfinished
            )  # else an effect they imitate would seem to explain it
            hessian = information + precision[np.ix_(entries, entries)]
            chi2 = max(0.0, float(score @ np.linalg.solve(hessian, score)))
            if len(score) > len(views) // 3:
                p_value = float(chdtrc(len(score), chi2 / max(dispersion, 1e-12)))
            else:
                by_view = np.array(
                    [part.sum(0) for part in np.split(unlike * off[:, None], starts)]
                )
                by_view += (score - by_view.sum(0)) / len(by_view)  # the prior's share
                p_value = min(
                    1.0,
                    2
                    * min(
                        _hotelling(by_view),
                        jackknife(residual, np.split(unlike, starts), score, hessian),
                    ),
                )
            return ScoreTest(
                effect,
                unlike,
                float((new**2).sum()),
                chi2,
                len(score),
                p_value,
                float(off @ off),
                information,
                score,
            )

        return [scored(effect) for effect in effects]

    @property
    def deviation(self) -> Array:
        """(S,) of the fitted parameters' vector from its prior's mean."""
        return np.asarray(self.model.parameters.vector(self.joint.values).numpy())

    def parameters(self, effects: Sequence[Effect] = ()) -> Parameters:
        """The fitted ones, where the fit ended, then those of further effects, where these are not
        there.
        """
        wider = self.model.with_effects(effects)
        neutral = {
            name: value
            for effect in effects
            for name, value in self.model.neutral_values(effect).items()
        }
        return Parameters.of(
            wider.path, {**self.joint.values, **neutral}, wider.priors, last=neutral
        )

    def equations(self, effects: Sequence[Effect] = ()) -> Iterator[ViewEquations]:
        """Every view's, in `parameters(effects)`."""
        wider = self.model.with_effects(effects)
        return view_equations(
            wider.path,
            self.parameters(effects),
            self.observations,
            wider.pad_poses(self.joint.poses),
            self.joint.sigma,
        )

    def information(self, effects: Sequence[Effect] = ()) -> Array:
        """(V, S, S) what each view says of `parameters(effects)`, its own parameters unknown."""
        return information(self.equations(effects), self.parameters(effects).count)

    def prior_precision(self, effects: Sequence[Effect] = ()) -> Array:
        """(S, S) of `parameters(effects)`."""
        return self.parameters(effects).prior_precision(self.joint.smoothness)

    def _of_views(
        self, effect: Effect, views: Sequence[ViewEquations], own: NDArray[np.int64], new: slice
    ) -> ScoreTest:
        """The score of parameters that every view has for itself, the `new` columns, beside the
        `own` that it has already.
        """
        chi2, squares, dof = 0.0, 0.0, 0
        for view in views:
            residual, more = (
                project_out(view.jacobian_block[:, own], rows)
                for rows in (view.residual, view.jacobian_block[:, new])
            )
            directions = orthonormal_basis(more)
            chi2 += float(((directions.T @ residual) ** 2).sum())
            squares += float((residual**2).sum())
            dof += directions.shape[1]
        left = max(1, self._freedom() - dof)
        typical = (squares - chi2) / left  # what is left with them, for each degree of freedom
        p_value = float(fdtrc(dof, left, max(0.0, chi2 / dof / typical)))
        return ScoreTest(
            effect,
            np.zeros((0, 0)),
            0.0,
            chi2,
            dof,
            p_value,
            squares,
            np.zeros((0, 0)),
            np.zeros(0),
        )

    def _freedom(self) -> int:
        return 2 * len(self.observations.pixels) - self.joint.poses.numel()


def _hotelling(by_view: Array) -> float:
    """The p-value of Hotelling's T^2: whether the views' scores of the effect's parameters, (V, k),
    agree on a direction away from neutral. It bears views with bad corners, whose own scatter
    enters its denominator.
    """
    views, dof = by_view.shape
    mean = by_view.mean(0)
    scatter = np.cov(by_view, rowvar=False).reshape(dof, dof)
    scale = np.sqrt(np.maximum(scatter.diagonal(), 1e-300))
    t2 = views * float(
        (mean / scale)
        @ np.linalg.pinv(scatter / np.outer(scale, scale), rcond=1e-10)
        @ (mean / scale)
    )
    return float(fdtrc(dof, views - dof, (views - dof) / (dof * (views - 1)) * max(0.0, t2)))
