"""What each effect would add to the fit's derivatives, with everything taken out that the fitted numbers can do already.

At the optimum, an effect that is missing leaves a residual along its own columns: chi^2 = |Q^T r|^2 / sigma^2 says how much without
fitting anything again. Rao's score test; C. R. Rao (1948), Large sample tests of statistical hypotheses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy import stats
from torch import Tensor

from calib.effects.effect import Effect
from calib.estimation.camera_model import Model
from calib.estimation.levenberg_marquardt import Linearised
from calib.estimation.map_fit import JointFit, shared_precision
from calib.estimation.objective import LandingProblem, Shared, view_precision
from calib.estimation.observations import Observations
from calib.estimation.residual_blocks import landings, pixel_weights
from calib.optics.params import Values

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Columns:
    """One candidate's part of the derivatives."""

    effect: Effect
    scaled: Array
    """(2M, k) px over sigma, by each of its numbers over its scale, poses and fitted numbers taken out; (2M, 0) for numbers of views."""
    raw: float
    """Sum of squares of the same with only the poses taken out."""
    chi2: float
    """By how much its numbers would lower the sum of squares."""
    dof: int
    p_value: float
    """From how the views agree, if there are enough of them for its numbers; else from chi2 over the residual's dispersion."""

    cost: float
    """The fit's sum of squares."""
    information: Array
    """(k, k) on its numbers, with the prior of the fitted ones but not of its own; (0, 0) for numbers of views."""
    pull: Array
    """(k,) of the residual on its numbers."""

    @property
    def promises(self) -> float:
        """The fraction by which it would lower the root mean square at best."""
        return 1.0 - float(np.sqrt(1.0 - min(1.0, self.chi2 / self.cost)))

    @property
    def absorbed(self) -> float:
        """The fraction of the effect that the fitted numbers can imitate, 0 to 1."""
        return 1.0 - float((self.scaled**2).sum()) / self.raw if self.raw > 0 else 0.0

    def span(self) -> Array:
        """(2M, n) orthonormal: the directions in which it moves corners and nothing else does."""
        return orthogonal(self.scaled)


@dataclass(frozen=True, slots=True, eq=False)
class Optimum:
    """A fit where it ended, linearised."""

    model: Model
    observations: Observations
    joint: JointFit

    def candidate(self, effect: Effect) -> Columns:
        """The score of one effect, with the prior that suits the residual."""
        scored = self.scored(effect)
        tuned = effect.tuned(scored.information, scored.pull)
        return scored if tuned == effect else self.scored(tuned)

    def scored(self, effect: Effect) -> Columns:
        """The score of one effect as it is."""
        wider = self.model.with_effect(effect)
        values = {**self.joint.values, **self.model.neutral(effect)}
        own = [u.param.name for u in effect.unknowns]
        at = self._linearised(wider, values, own)
        blocks = self._pieces(at.jacobian_block)
        residual = self._pieces(at.residual.unsqueeze(-1))
        old_numbers = self.joint.poses.shape[1]
        rest = [orthogonal(block[:, :old_numbers]) for block in blocks]
        if effect.per_view:
            return self._of_views(effect, blocks, residual, rest)
        count = sum(int(np.prod(u.param.shape)) for u in effect.unknowns)
        shared = [piece - q @ (q.T @ piece) for piece, q in zip(self._pieces(at.jacobian_shared), rest, strict=True)]
        whole, off = np.concatenate(shared), np.concatenate([r - q @ (q.T @ r) for r, q in zip(residual, rest, strict=True)])[:, 0]
        known, new = whole[:, : whole.shape[1] - count], whole[:, whole.shape[1] - count :]
        precision = shared_precision(self.model.path, self.joint.smoothness, self.model.free, self.model.means)
        curvature = known.T @ known + precision
        imitated = np.linalg.solve(curvature, known.T @ new)
        left = new - known @ imitated
        prior = np.concatenate([np.full(int(np.prod(u.param.shape)), (u.param.scale / u.sigma) ** 2) for u in effect.unknowns])
        pull = new.T @ off  # what the fitted numbers add cancels against their prior: the fit has converged
        chi2 = float(pull @ np.linalg.solve(new.T @ left + np.diag(prior), pull))
        by_view = np.array([part.sum(0) for part in np.split(left * off[:, None], self._ends())])
        by_view += (pull - by_view.sum(0)) / len(by_view)  # the prior's share
        p_value = _p_value(by_view, chi2, count, float(off @ off) / max(1, self._freedom()))
        return Columns(effect, left, float((new**2).sum()), chi2, count, p_value, float(off @ off), new.T @ left, pull)

    def slopes(self) -> list[tuple[Array, Array]]:
        """(2m, B) and (2m, S) of each view, px over sigma: by its own numbers, and by those that views share."""
        at = self._linearised(self.model, self.joint.values, ())
        return list(zip(self._pieces(at.jacobian_block), self._pieces(at.jacobian_shared), strict=True))

    def information(self, effects: Sequence[Effect]) -> Array:
        """(V, S, S) what each view says of the fitted numbers, and then of the effects' own, at neutral; its own numbers unknown."""
        wider = self.model.with_effects(effects)
        values = dict(self.joint.values)
        for effect in effects:
            values |= self.model.neutral(effect)
        at = self._linearised(wider, values, [u.param.name for effect in effects for u in effect.unknowns])
        found = []
        for block, piece in zip(self._pieces(at.jacobian_block), self._pieces(at.jacobian_shared), strict=True):
            q = orthogonal(block)
            left = piece - q @ (q.T @ piece)
            found.append(left.T @ left)
        return np.array(found)

    def _of_views(self, effect: Effect, blocks: list[Array], residual: list[Array], rest: list[Array]) -> Columns:
        """The score of numbers that every view has for itself."""
        gains, dof = [], 0
        for block, r, q in zip(blocks, residual, rest, strict=True):
            more = block[:, self.joint.poses.shape[1] :]
            own = orthogonal(more - q @ (q.T @ more))
            gains.append(float(((own.T @ r) ** 2).sum()))
            dof += own.shape[1]
        off = sum(float(((r - q @ (q.T @ r)) ** 2).sum()) for r, q in zip(residual, rest, strict=True))
        chi2 = sum(gains)
        left = max(1, self._freedom() - dof)
        typical = (off - chi2) / left  # what is left with them, for each degree of freedom
        none = np.zeros((0, 0))
        return Columns(effect, none, 0.0, chi2, dof, float(stats.f.sf(chi2 / dof / typical, dof, left)), off, none, np.zeros(0))

    def _linearised(self, model: Model, values: Values, last: Sequence[str]) -> Linearised:
        """All rows at once, shared numbers ordered as those of the fit, then `last`."""
        path, seen = model.path, self.observations
        poses = model.padded(self.joint.poses)
        relief = path.cover[-1].relief if path.cover else None
        scales = {p.name: p.scale for p in path.params if p.name in self.joint.scales} | {
            p.name: p.scale for p in path.params if p.name in last
        }
        shared = Shared(values, relief, scales)
        weights = pixel_weights(path, values, seen, poses, self.joint.sigma)
        views = tuple(landings(path, values, seen, weights, tuple(scales), relief is not None))
        zero = poses.new_zeros(shared.count)
        pieces = list(LandingProblem(shared, views, zero.diag(), view_precision(poses)).linearise(zero, poses))
        parts = (torch.cat([getattr(p, name) for p in pieces]) for name in ("residual", "jacobian_block", "jacobian_shared"))
        return Linearised(seen.starts, *parts)

    def _pieces(self, rows: Tensor) -> list[Array]:
        """(M, 2, n) to one (2m, n) for each view."""
        return [part.flatten(0, 1).numpy() for part in self.observations.per_view(rows)]

    def _ends(self) -> Array:
        return np.asarray(2 * self.observations.starts[1:-1].numpy())

    def _freedom(self) -> int:
        return 2 * len(self.observations.pixels) - self.joint.poses.numel()


def orthogonal(columns: Array) -> Array:
    """An orthonormal basis of what columns span, those aside that do nothing."""
    length = np.linalg.norm(columns, axis=0)
    columns = columns[:, length > 1e-9 * max(length.max(initial=0.0), 1e-300)]
    u, s, _ = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), full_matrices=False)
    return np.asarray(u[:, s > 1e-7])


def _p_value(by_view: Array, chi2: float, dof: int, dispersion: float) -> float:
    """Hotelling's T^2: whether views pull the effect's numbers away from neutral together. It stands views with bad corners, whose own
    scatter enters its denominator."""
    views = len(by_view)
    if dof > views // 3:
        return float(stats.chi2.sf(chi2 / max(dispersion, 1e-12), dof))
    mean = by_view.mean(0)
    scatter = np.cov(by_view, rowvar=False).reshape(dof, dof)
    scale = np.sqrt(np.maximum(scatter.diagonal(), 1e-300))
    t2 = views * float((mean / scale) @ np.linalg.pinv(scatter / np.outer(scale, scale), rcond=1e-10) @ (mean / scale))
    return float(stats.f.sf((views - dof) / (dof * (views - 1)) * t2, dof, views - dof))
