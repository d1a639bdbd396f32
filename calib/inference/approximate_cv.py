"""Approximate cross-validation: fits without some of the views, from the fit to all views.

The equations of a fit are sums over its views, so the equations without some views are known. One
Gauss-Newton step from the fit to all views reaches the fit without them, to first order. If a step
does not lower the cost as predicted, a damped step is tried, or a further step from the end of the
first. If these fail as well, the remaining views are fitted. The own parameters of a view that is
left out follow by a step of their own.

Source: K. R. Rad, A. Maleki, A scalable estimate of the out-of-sample prediction error via
    approximate leave-one-out cross-validation (2020).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.covariance import invert_precision
from calib.estimation.joint_fit import Estimate
from calib.estimation.normal_equations import ReducedProducts
from calib.estimation.objective import LandingProblem, view_precision
from calib.estimation.orthogonal_projection import project_out
from calib.estimation.residuals import residuals
from calib.estimation.view_equations import landing_problem
from calib.inference.fitted_model import FittedModel
from calib.inference.laplace_evidence import view_columns

MAX_STEPS = 4
"""The largest number of steps before the remaining views are fitted."""
TOLERANCE = 0.1
"""The tolerated difference between the predicted and the actual decrease of the cost, per shared
parameter, over the noise variance. It corresponds to a third of a parameter's sigma.
"""
VIEW_TOLERANCE = 0.3
"""The same per view that is left out. A view has over a hundred residuals, so this is at most a
seventh of the gain that an effect must have.
"""
DAMPINGS = (0.0, 1e-7, 1e-5, 1e-3)
"""Levenberg-Marquardt damping, relative to the diagonal. In directions that the views leave open,
an undamped step is long and leaves the valley.
"""
DAMPED_REMAINDER = 0.15
"""The part of the first step's predicted decrease that a damped last step may leave."""


@dataclass(frozen=True, slots=True, eq=False)
class FitWithout:
    """A fit without some views."""

    joint: Estimate
    """The fit with the poses of all views. Views that are left out have the poses that fit them
    best.
    """
    residual: Tensor
    """(m, 2) px, the residual of the views that are left out; infinite where the model cannot see a
    corner.
    """
    prediction_variance: Tensor
    """(m,) the variance of these corners due to the covariance of the fit, over the noise
    variance.
    """


def fits_without(
    fitted: FittedModel, cost: float, groups: NDArray[np.int64], pose_corners: Tensor | None = None
) -> list[FitWithout]:
    """Return the fits without each group of views, with the noise and prior of the fit to all.

    Args:
        cost: the minimum of the fit to all views, `JointFit.cost`.
        groups: (V,) the group of each view, from 0.
        pose_corners: (M,) bool, the corners to which the own parameters of a view are fitted when
            it is left out; None for all.
    """
    if pose_corners is None:
        pose_corners = torch.ones(len(fitted.observations.pixels), dtype=torch.bool)
    expansion = _Expansion.of(fitted, cost, pose_corners)
    indices = range(int(groups.max()) + 1)
    return [expansion.without(torch.from_numpy(groups == index)) for index in indices]


@dataclass(frozen=True, slots=True, eq=False)
class _Step:
    """A step towards the fit without some views. Costs are over the noise variance."""

    joint: Estimate
    """The end of the step, with the poses of all views."""
    residual: Tensor
    """(M, 2) px"""
    decrease: float
    """The actual decrease of the cost of the remaining views."""
    predicted: float
    """The predicted decrease."""
    remainder: float
    """The predicted decrease of an undamped step beyond this one."""
    view_excess: float
    """The cost of the views that are left out beyond the prediction of their own steps."""


@dataclass(frozen=True, slots=True, eq=False)
class _Expansion:
    """The second-order expansion of the cost at the fit to all views or after a step from it."""

    fitted: FittedModel
    cost: float
    """The minimum of the fit to all views."""
    pose_corners: Tensor
    """(M,) bool, see `fits_without`."""
    columns: list[Tensor]
    """(2m, B + S + 1) for each view, see `view_columns`."""
    reduced: ReducedProducts
    """The products of the S shared columns and the residual, the views' own parameters
    eliminated.
    """
    pose_reduced: ReducedProducts
    """The same from `pose_corners` alone."""
    problem: LandingProblem
    losses: Tensor
    """(M,) the losses of the corners."""
    squares: Tensor
    """(V,) the squares of the residuals at `pose_corners` and of the prior of the own
    parameters.
    """

    @classmethod
    def of(cls, fitted: FittedModel, cost: float, pose_corners: Tensor) -> _Expansion:
        joint = fitted.joint
        columns = list(view_columns(fitted))
        precision = view_precision(fitted.model.path, joint.poses)
        reduced = _reduce(columns, precision)
        pose_reduced = reduced
        if not bool(pose_corners.all()):
            rows = fitted.observations.per_view(pose_corners)
            selected = [
                view_columns[mask.repeat_interleave(2)]
                for view_columns, mask in zip(columns, rows, strict=True)
            ]
            pose_reduced = _reduce(selected, precision)
        problem = landing_problem(
            fitted.model.path, fitted.parameters(), fitted.observations, joint.poses, joint.sigma
        )
        origin = torch.zeros(fitted.model.parameters.count, dtype=torch.float64)
        losses = problem.losses(*problem.residual(origin, joint.poses))
        shared = torch.from_numpy(np.append(fitted.deviation, 1.0)).expand(len(columns), -1)
        point = torch.cat([joint.poses * (precision > 0), shared], 1)
        residual = torch.cat(
            [matrix @ vector for matrix, vector in zip(columns, point, strict=True)]
        )
        corner_squares = residual.reshape(-1, 2).square().sum(1)
        squares = _sum_by_view(fitted, torch.where(pose_corners, corner_squares, 0.0))
        return cls(
            fitted=fitted,
            cost=cost,
            pose_corners=pose_corners,
            columns=columns,
            reduced=reduced,
            pose_reduced=pose_reduced,
            problem=problem,
            losses=losses,
            squares=squares + problem.block_prior(joint.poses),
        )

    def without(
        self, removed: Tensor, max_steps: int = MAX_STEPS, max_remainder: float = 0.0
    ) -> FitWithout:
        """Return the fit without the views of (V,) `removed`.

        Args:
            max_remainder: the predicted decrease that the last step may leave.
        """
        fitted = self.fitted
        tolerance = TOLERANCE * fitted.model.parameters.count
        best = None
        for damping in DAMPINGS:
            step = self._step(removed, damping)
            full_decrease = step.remainder + step.predicted
            max_remainder = max(max_remainder, DAMPED_REMAINDER * full_decrease)
            # Written so that NaN fails the comparisons.
            is_last = step.remainder <= max_remainder
            if is_last and abs(step.decrease - step.predicted) <= tolerance:
                return self._score_step(step, removed)
            if step.decrease > (best.decrease if best else 0):
                best = step
            if not is_last or step.decrease > step.predicted:  # more damping gains nothing
                break
        if best and max_steps > 1:
            expansion = _Expansion.of(
                replace(fitted, joint=best.joint), self.cost, self.pose_corners
            )
            return expansion.without(removed, max_steps - 1, max_remainder)
        return self._score_fit(_fit_remaining(fitted, self.cost, removed), removed)

    def _step(self, removed: Tensor, damping: float) -> _Step:
        """Step towards the optimum of the remaining views."""
        fitted = self.fitted
        joint = fitted.joint
        parameters = fitted.model.parameters
        precision = torch.from_numpy(fitted.prior_precision())
        start = torch.from_numpy(fitted.deviation)
        reduced = self.reduced.products[~removed].sum(0)
        hessian = reduced[:-1, :-1] + precision
        covariance = invert_precision(hessian)
        optimum = -covariance @ reduced[:-1, -1]
        vector = optimum
        if damping:
            damped = invert_precision(hessian + damping * hessian.diagonal().diag())
            vector = start + damped @ (hessian @ (optimum - start))
        values = parameters.values(vector)
        values |= {
            param.name: values[param.name].clamp_min(param.minimum) for param in parameters.free
        }
        homogeneous = torch.cat([vector, vector.new_ones(1)])
        without_prior = view_precision(fitted.model.path, joint.poses) == 0
        response = torch.where(
            removed[:, None, None], self.pose_reduced.response, self.reduced.response
        )
        poses = joint.poses * without_prior - response @ homogeneous
        residual, visible = self.problem.residual(self.problem.parameters.vector(values), poses)
        increase = self.problem.losses(residual, visible) - self.losses
        own_increase = self.problem.block_prior(poses)
        own_increase = own_increase - self.problem.block_prior(joint.poses)
        prior_decrease = float(start @ precision @ start - vector @ precision @ vector)
        remaining_increase = (_sum_by_view(fitted, increase) + own_increase)[~removed].sum()
        remainder = float((vector - optimum) @ hessian @ (vector - optimum))
        full_decrease = float((start - optimum) @ hessian @ (start - optimum))
        pixels = residual * (joint.sigma / fitted.observations.weight)[:, None]
        minimum = torch.einsum("s,vst,t->v", homogeneous, self.pose_reduced.products, homogeneous)
        pose_increase = _sum_by_view(fitted, torch.where(self.pose_corners, increase, 0.0))
        excess = pose_increase + own_increase - (minimum - self.squares)
        return _Step(
            joint=replace(joint, values=values, poses=poses, covariance=covariance),
            residual=torch.where(visible[:, None], pixels, torch.inf).nan_to_num(torch.inf),
            decrease=prior_decrease - float(remaining_increase),
            predicted=full_decrease - remainder,
            remainder=remainder,
            view_excess=float(excess[removed].sum()),
        )

    def _score_step(self, step: _Step, removed: Tensor) -> FitWithout:
        """Return the fit at the end of a step whose decrease is as predicted."""
        if not abs(step.view_excess) <= VIEW_TOLERANCE * int(removed.sum()):
            return self._score_fit(step.joint, removed)
        return FitWithout(
            step.joint,
            step.residual[removed[self.fitted.observations.view]],
            self._prediction_variance(step.joint.covariance, removed),
        )

    def _score_fit(self, joint: Estimate, removed: Tensor) -> FitWithout:
        """Fit the poses of the removed views to a fit without them."""
        fitted = self.fitted
        views = fitted.observations.without_views(~removed)
        poses = joint.poses.clone()
        pose_corners = self.pose_corners[removed[fitted.observations.view]]
        poses[removed] = fitted.model.fit_poses(
            joint, views.select_rows(pose_corners), joint.poses[removed]
        )
        residual = residuals(fitted.model.path, joint.values, views, poses[removed]).image
        return FitWithout(
            replace(joint, poses=poses),
            residual.nan_to_num(torch.inf),
            self._prediction_variance(joint.covariance, removed),
        )

    def _prediction_variance(self, covariance: Tensor, removed: Tensor) -> Tensor:
        size = self.fitted.model.parameters.count
        variances = []
        for columns, is_removed in zip(self.columns, removed.tolist(), strict=True):
            if is_removed:
                own_columns = columns[:, : -size - 1].numpy()
                shared_columns = columns[:, -size - 1 : -1].numpy()
                jacobian = torch.from_numpy(project_out(own_columns, shared_columns))
                variance = ((jacobian @ covariance) * jacobian).sum(1)
                variances.append(variance.reshape(-1, 2).mean(1))
        return torch.cat(variances).nan_to_num(torch.inf)


def _reduce(columns: list[Tensor], precision: Tensor) -> ReducedProducts:
    """Eliminate the views' own parameters from their columns."""
    products = torch.stack([matrix.mT @ matrix for matrix in columns])
    return ReducedProducts.of(products, precision)


def _sum_by_view(fitted: FittedModel, losses: Tensor) -> Tensor:
    """Return (V,) sums of (M,) losses over the corners of each view."""
    sums = losses.new_zeros(len(fitted.joint.poses))
    return sums.index_add(0, fitted.observations.view, losses)


def _fit_remaining(fitted: FittedModel, cost: float, removed: Tensor) -> Estimate:
    """Fit the remaining views from the fit to all."""
    joint = fitted.joint
    tolerance = TOLERANCE * max(fitted.model.parameters.count, 1) / cost
    remaining = fitted.model.fit(
        fitted.observations.without_views(removed), joint.poses[~removed], joint.start, (tolerance,)
    )
    poses = joint.poses.clone()
    poses[~removed] = remaining.poses
    return replace(remaining, poses=poses)
