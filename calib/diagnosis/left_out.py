"""Fits without some of the views, from the fit to all of them, and what they leave of these views.

A fit's equations are the sums of its views' own, so what is left without some is known, and one
step of Gauss and Newton from the fit to all leads where a fit without them ends, to first order.
Where it does not do what it promised, a shorter one may, or another from where it led; where that
fails, the other views are fitted. The views that were left out adapt by a step of their own.

Source: K. R. Rad, A. Maleki, A scalable estimate of the out-of-sample prediction error via
    approximate leave-one-out cross-validation
(2020).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.diagnosis.linearised import columns_of, schur_factors
from calib.diagnosis.score_test import Optimum
from calib.estimation.elimination import landing_problem, project_out
from calib.estimation.joint_fit import JointFit, invert_precision
from calib.estimation.objective import LandingProblem, view_precision
from calib.estimation.residuals import residuals

STEPS = 4
"""At most, before the others are fitted."""
AMISS = 0.1
"""Of the noise's square for each shared parameter, a third of its sigma: a step may do so much more
or less than it promises.
"""
AMISS_OUT = 0.3
"""The same for each view that was left out: of a hundred numbers and more, a seventh of what is
worth an effect, or less.
"""
DAMPINGS = (0.0, 1e-7, 1e-5, 1e-3)
"""Of the diagonal: a step along what views leave open goes far for nothing, and off the valley's
floor.
"""
SHORT = 0.15
"""Of what the first whole step promised, that the last one may leave."""


@dataclass(frozen=True, slots=True, eq=False)
class LeftOut:
    """The fit without some views."""

    joint: JointFit
    """With the poses of all views: those that were left out stand where their corners are met best.
    """
    missed: Tensor
    """(m, 2) px, what is left of the corners of the views that were left out; infinite where the
    model cannot see one.
    """
    spread: Tensor
    """(m,) of what the covariance of the fit's parameters makes of these corners, over the noise's
    variance.
    """


def without_each(
    at: Optimum, part: NDArray[np.int64], known: Tensor | None = None
) -> list[LeftOut]:
    """The fits without each part of the views, with the noise and the prior of the fit to all.

    Args:
        part: (V,) from 0 on.
        known: (M,) the corners to which a view's own parameters are fitted when it was left out;
            None: all.
    """
    known = torch.ones(len(at.observations.pixels), dtype=torch.bool) if known is None else known
    steps = _Steps.of(at, known)
    return [steps.without(torch.from_numpy(part == index)) for index in range(int(part.max()) + 1)]


@dataclass(frozen=True, slots=True, eq=False)
class _Tried:
    """A step without some views. All but the first two are squares over the noise's."""

    joint: JointFit
    """There, with all views' poses."""
    missed: Tensor
    """(M, 2) px"""
    gained: float
    """Of the views that stay."""
    promised: float
    short: float
    """What the whole step promises beyond this one."""
    lags: float
    """What the views that were left out have left there, beyond what their own steps promised."""


@dataclass(frozen=True, slots=True, eq=False)
class _Steps:
    """What the equations say where the fit to all views ended, or where a step from there led."""

    at: Optimum
    known: Tensor
    """(M,) as `without_each` has it."""
    columns: list[Tensor]
    """(2m, B + S + 1) of each view."""
    schur: Tensor
    """(V, S + 1, S + 1) what each view says of the shared parameters, its own eliminated."""
    moves: Tensor
    """(V, B, S + 1) by which its own parameters follow the shared ones."""
    schur_known: Tensor
    """(V, S + 1, S + 1) the same by the corners that are known of a view that was left out."""
    moves_known: Tensor
    problem: LandingProblem
    losses: Tensor
    """(M,) there."""
    squares: Tensor
    """(V,) of the corners that are known of a view that was left out, and of what is known of its
    own parameters, there.
    """

    @classmethod
    def of(cls, at: Optimum, known: Tensor) -> _Steps:
        columns = list(columns_of(at))
        precision = view_precision(at.model.path, at.joint.poses)
        schur, moves = _own_eliminated(columns, precision)
        schur_known, moves_known = schur, moves
        if not bool(known.all()):
            rows = at.observations.per_view(known)
            some = [own[kept.repeat_interleave(2)] for own, kept in zip(columns, rows, strict=True)]
            schur_known, moves_known = _own_eliminated(some, precision)
        problem = landing_problem(
            at.model.path, at.parameters(), at.observations, at.joint.poses, at.joint.sigma
        )
        losses = problem.losses(
            *problem.residual(
                torch.zeros(at.model.parameters.count, dtype=torch.float64), at.joint.poses
            )
        )
        there = torch.cat(
            [
                at.joint.poses * (precision > 0),
                torch.from_numpy(np.append(at.deviation, 1.0)).expand(len(columns), -1),
            ],
            1,
        )
        left = (
            torch.cat([own @ here for own, here in zip(columns, there, strict=True)])
            .reshape(-1, 2)
            .square()
            .sum(1)
        )
        squares = _by_view(at, torch.where(known, left, 0.0)) + problem.block_prior(at.joint.poses)
        return cls(
            at, known, columns, schur, moves, schur_known, moves_known, problem, losses, squares
        )

    def without(self, out: Tensor, steps: int = STEPS, least: float = 0.0) -> LeftOut:
        """Without (V,) the views; a last step may leave so much to gain."""
        at, enough = self.at, AMISS * self.at.model.parameters.count
        best = None
        for damping in DAMPINGS:
            tried = self._tried(out, damping)
            least = max(least, SHORT * (tried.short + tried.promised))
            if (
                tried.short <= least and abs(tried.gained - tried.promised) <= enough
            ):  # not true of what is not a number
                return self._left(tried, out)
            if tried.gained > (best.gained if best else 0):
                best = tried
            if (
                not tried.short <= least or tried.gained > tried.promised
            ):  # a shorter one would not gain more
                break
        if best and steps > 1:
            return _Steps.of(replace(at, joint=best.joint), self.known).without(
                out, steps - 1, least
            )
        return self._seen(_fitted(at, out), out)

    def _tried(self, out: Tensor, damping: float) -> _Tried:
        """A step towards the others' optimum, shorter in directions that they say little of."""
        at, parameters = self.at, self.at.model.parameters
        precision, here = torch.from_numpy(at.prior_precision()), torch.from_numpy(at.deviation)
        left = self.schur[~out].sum(0)
        hessian = left[:-1, :-1] + precision
        covariance = invert_precision(hessian)
        best = -covariance @ left[:-1, -1]
        vector = (
            here
            + invert_precision(hessian + damping * hessian.diagonal().diag())
            @ (hessian @ (best - here))
            if damping
            else best
        )
        values = parameters.values(vector)
        values |= {
            param.name: values[param.name].clamp_min(param.minimum) for param in parameters.free
        }
        whole = torch.cat([vector, vector.new_ones(1)])
        stay = at.joint.poses * (view_precision(at.model.path, at.joint.poses) == 0)
        poses = stay - torch.where(out[:, None, None], self.moves_known, self.moves) @ whole
        residual, lands = self.problem.residual(self.problem.parameters.vector(values), poses)
        worse = self.problem.losses(residual, lands) - self.losses
        own = self.problem.block_prior(poses) - self.problem.block_prior(at.joint.poses)
        short = float((vector - best) @ hessian @ (vector - best))
        missed = residual * (at.joint.sigma / at.observations.weight)[:, None]
        least = torch.einsum("s,vst,t->v", whole, self.schur_known, whole) - self.squares
        return _Tried(
            joint=replace(at.joint, values=values, poses=poses, covariance=covariance),
            missed=torch.where(lands[:, None], missed, torch.inf).nan_to_num(torch.inf),
            gained=float(here @ precision @ here - vector @ precision @ vector)
            - float((_by_view(at, worse) + own)[~out].sum()),
            promised=float((here - best) @ hessian @ (here - best)) - short,
            short=short,
            lags=float(
                (_by_view(at, torch.where(self.known, worse, 0.0)) + own - least)[out].sum()
            ),
        )

    def _left(self, tried: _Tried, out: Tensor) -> LeftOut:
        """What is left after a step that did what it promised."""
        if not abs(tried.lags) <= AMISS_OUT * int(out.sum()):
            return self._seen(tried.joint, out)
        return LeftOut(
            tried.joint,
            tried.missed[out[self.at.observations.view]],
            self._spread(tried.joint.covariance, out),
        )

    def _seen(self, rest: JointFit, out: Tensor) -> LeftOut:
        """The views that were left out of a fit, fitted to it."""
        at = self.at
        test = at.observations.without_views(~out)
        poses = rest.poses.clone()
        poses[out] = at.model.fit_poses(
            rest, test.select_rows(self.known[out[at.observations.view]]), rest.poses[out]
        )
        missed = residuals(at.model.path, rest.values, test, poses[out]).image.nan_to_num(torch.inf)
        return LeftOut(replace(rest, poses=poses), missed, self._spread(rest.covariance, out))

    def _spread(self, covariance: Tensor, out: Tensor) -> Tensor:
        own = self.schur.shape[-1] - 1
        found = []
        for columns in (
            columns for columns, there in zip(self.columns, out.tolist(), strict=True) if there
        ):
            left = torch.from_numpy(
                project_out(columns[:, : -own - 1].numpy(), columns[:, -own - 1 : -1].numpy())
            )
            found.append(((left @ covariance) * left).sum(1).reshape(-1, 2).mean(1))
        return torch.cat(found).nan_to_num(torch.inf)


def _own_eliminated(columns: list[Tensor], precision: Tensor) -> tuple[Tensor, Tensor]:
    """(V, S + 1, S + 1) products of the other columns with themselves once each view's own
    parameters adapt, and (V, B, S + 1) how.
    """
    own = len(precision)
    schur, moves = [], []
    for each in columns:
        through, factor = (
            found[0] for found in schur_factors((each[:, :own].mT @ each)[None], precision)
        )
        others = each[:, own:]
        schur.append(others.mT @ others - through.mT @ through)
        moves.append(torch.linalg.solve_triangular(factor.mT, through, upper=True))
    return torch.stack(schur), torch.stack(moves)


def _by_view(at: Optimum, losses: Tensor) -> Tensor:
    return losses.new_zeros(len(at.joint.poses)).index_add(0, at.observations.view, losses)


def _fitted(at: Optimum, out: Tensor) -> JointFit:
    close = AMISS * at.model.parameters.count / at.joint.cost
    rest = at.model.fit(
        at.observations.without_views(out), at.joint.poses[~out], at.joint.start, (close,)
    )
    poses = at.joint.poses.clone()
    poses[~out] = rest.poses
    return replace(rest, poses=poses)
