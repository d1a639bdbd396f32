"""The linearised residuals of all views by every number that may differ from view to view."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.effects.board_scale import DEGREES as PRINT_DEGREES
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import DEGREES as BEND_DEGREES
from calib.effects.board_shape import BoardShape
from calib.effects.effect import Effect, EffectContext
from calib.effects.lens import LensEffect
from calib.effects.rolling_shutter import RollingShutter
from calib.estimation.camera_model import CameraModel
from calib.estimation.objective import view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.view_equations import view_equations
from calib.inference.fitted_model import FittedModel
from calib.inference.laplace_evidence import LaplaceEvidence
from calib.inference.model_discrepancy import Discrepancy
from calib.inference.variation import Variation
from calib.inference.varying_numbers import Group
from calib.optics.relief import AMPLITUDES
from calib.optics.view_blocks import MOTION, block_columns
from calib.session.tolerances import BOARD_MOVE, BOARD_SPIN

MIN_PRECISION = 1e-12
"""The smallest prior precision, over the largest, of an axis that has a prior."""

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class VariationRows:
    """The linearised residuals of all views by their own parameters, by the shared parameters, and
    by every number that may differ.
    """

    views: tuple[Array, ...]
    """(2m, B + n + 1) for each view, over the noise of the fit: its own parameters, n columns, and
    the residual with all parameters at their prior means.
    """
    own_precision: Tensor
    """(B,) the prior precision of the views' own parameters; 0 without a prior."""
    precision: Array
    """(S, S) prior precision of the shared parameters."""
    shared: NDArray[np.int64]
    """(S,) their places among the n columns."""
    motion: int
    """The number of columns of a board's motion, the first ones: 6, or 0 if the model has it."""
    entries: Mapping[str, tuple[int, float, float]]
    """For each number: its place, its scale and its value."""
    observations: Observations

    @staticmethod
    def of(fitted: FittedModel, context: EffectContext) -> VariationRows:
        """Linearise around a fit."""
        base = fitted.model
        full = _completed(base.with_effects(_probes(base, context)))
        values = {**full.means, **fitted.joint.values}
        held = {
            param.name: 1.0
            for param in full.path.params
            if param.name in values  # not those that an effect computes from its own
            and param.name not in full.priors.sigmas
            and param.name != AMPLITUDES
        }
        parameters = Parameters.of(full.path, values, full.priors.with_sigmas(held))
        estimated = Parameters.of(base.path, values, base.priors)
        blocks = block_columns(full.path.view_blocks)
        own_columns = np.concatenate([np.r_[blocks[block]] for block in base.path.view_blocks])
        motion_columns = np.arange(0) if base.path.shutter else np.r_[blocks[MOTION]]
        columns = parameters.entries(estimated.slices())
        own_precision = view_precision(base.path, fitted.joint.poses)
        poses = full.pad_poses(fitted.joint.poses)
        equations = view_equations(
            full.path,
            parameters,
            fitted.observations,
            poses,
            fitted.joint.sigma,
            fitted.weights,
        )
        views = []
        for view, pose in zip(equations, fitted.joint.poses.numpy(), strict=True):
            block = view.jacobian_block[:, own_columns]
            at_prior_means = block @ (pose * (own_precision.numpy() > 0))
            at_prior_means += view.jacobian_shared[:, columns] @ fitted.deviation
            columns_left = view.jacobian_block[:, motion_columns], view.jacobian_shared
            views.append(np.column_stack([block, *columns_left, view.residual - at_prior_means]))
        scales = [1.0] * parameters.amplitudes + parameters.scales.tolist()
        return VariationRows(
            views=tuple(views),
            own_precision=own_precision,
            precision=estimated.prior_precision(fitted.joint.smoothness),
            shared=len(motion_columns) + columns,
            motion=len(motion_columns),
            entries={
                name: (len(motion_columns) + place.start, scales[place.start], float(values[name]))
                for name, place in parameters.slices().items()
                if not values[name].ndim
            },
            observations=fitted.observations,
        )

    @cached_property
    def products(self) -> tuple[Array, ...]:
        """(B + n + 1, B + n + 1) inner products of each view's columns."""
        return tuple(view.T @ view for view in self.views)

    @property
    def own(self) -> int:
        """The number of parameters of each view."""
        return len(self.own_precision)

    @property
    def prior_precisions(self) -> Array:
        """The prior precisions of the shared parameters, along the axes that have one."""
        sizes = np.linalg.eigvalsh(self.precision)
        return np.asarray(sizes[sizes > MIN_PRECISION * sizes.max(initial=0.0)])

    def columns(self, group: Group) -> Array:
        """Return (n + 1, G) the deviations of a group's numbers, over their tolerances, in terms of
        the columns.
        """
        count = self.views[0].shape[1] - self.own
        if not group.numbers:
            columns = np.zeros((count, self.motion))
            columns[: self.motion] = np.diag([BOARD_SPIN.sigma] * 3 + [BOARD_MOVE.sigma] * 3)
            return columns
        columns = np.zeros((count, len(group.numbers)))
        for index, number in enumerate(group.numbers):
            for name in number.shifts:
                column, scale, value = self.entries[name]
                change = value if number.relative else 1.0
                columns[column, index] = number.sigma * change / scale
        return columns

    def discrepancy(self, solution: Array, variation: Variation | None = None) -> Discrepancy:
        """Return the most probable discrepancy, with the shared parameters held at a (S,) solution:
        that with all parameters takes a hundred times as long.

        Args:
            variation: numbers that differ beside it: of each view's own, or as estimated.
        """
        has_own = variation is not None and not variation.pattern.size
        views = []
        for index, rows in enumerate(self.views):
            block, columns_left = rows[:, : self.own], rows[:, self.own :]
            residual = columns_left[:, -1] + columns_left[:, self.shared] @ solution
            if variation:
                differing = columns_left @ self.columns(variation.group)
                if has_own:
                    block = np.column_stack([block, differing * variation.scales])
                else:
                    residual = residual + differing @ variation.deviations[index]
            views.append(torch.from_numpy(np.column_stack([block, residual])))
        evidence = LaplaceEvidence(tuple(views), torch.zeros(0, 0, dtype=torch.float64))
        added = views[0].shape[1] - 1 - self.own
        own_precision = torch.cat([self.own_precision, self.own_precision.new_ones(added)])
        return Discrepancy.of(evidence, self.observations, own_precision)


def _probes(model: CameraModel, context: EffectContext) -> list[Effect]:
    """Return effects whose parameters may differ from view to view and that the model lacks."""
    present = {effect.name for effect in model.effects if not effect.varies}
    half = context.board.half
    probes: list[Effect] = [LensEffect()]
    if context.board.is_flat:
        probes += [BoardShape(*half), BoardScale(True, half=half)]
    if not model.path.shutter:
        probes.append(RollingShutter())
    return [probe for probe in probes if probe.name not in present]


def _completed(model: CameraModel) -> CameraModel:
    """Return the model with the terms of its board that may differ: of zero, if it had none."""
    target = model.path.target
    prints = [
        replace(print_, sheared=True, degree=max(print_.degree, PRINT_DEGREES[0]))
        if isinstance(print_, BoardScale)
        else print_
        for print_ in target.prints
    ]
    bends = [
        replace(bend, degree=max(bend.degree, BEND_DEGREES[-1]))
        if isinstance(bend, BoardShape)
        else bend
        for bend in target.bends
    ]
    target = replace(target, prints=tuple(prints), bends=tuple(bends))
    zeros = {param.name: torch.zeros((), dtype=torch.float64) for param in target.params}
    return replace(model, path=replace(model.path, target=target), means={**zeros, **model.means})
