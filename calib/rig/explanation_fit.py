"""The most probable numbers of explanations, and the evidence for each."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from calib.rig.board_motion import BoardDisplacement
from calib.rig.explanations import SMALLEST, RigExplanation, own_motion
from calib.rig.motion_evidence import FixedEstimate, FixedMotion, RandomMotion, ReducedMotions
from calib.rig.rig_context import DISCREPANCY, RigContext, roots
from calib.rig.rig_effects import LATENESS

MOMENT = 1e-3
"""s: the time over which the speed of the board is taken before the lateness is known."""
STEP = 0.2
"""The step of the logarithm of a size by which the curvature of the evidence is taken."""
REPEATS = 3
"""The lateness and the uncertainty of the speeds depend on each other; each repeat leaves a
hundredth of the difference.
"""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class FittedExplanation:
    """An explanation with its most probable numbers."""

    explanation: RigExplanation
    log_evidence: float
    """With the prior odds, up to a constant that all explanations of one search share."""
    sizes: Array
    """(k,) the sizes of the random motions; the last two are those of the disagreement without a
    cause, px.
    """
    size_sigmas: Array
    """(k,) their standard deviations."""
    estimate: FixedEstimate | None
    fixed: FixedMotion | None
    """The motion by the numbers of `estimate`."""
    random: tuple[RandomMotion, ...]
    """The random motions without the disagreement of no cause."""
    discrepancy: tuple[RandomMotion, ...]
    """The disagreement of no cause."""


class Evaluator:
    """The evidence of explanations in one context."""

    def __init__(self, context: RigContext) -> None:
        self.context = context

    def fit(self, explanation: RigExplanation) -> FittedExplanation:
        """Return the most probable numbers of an explanation, and its evidence."""
        if explanation.is_late:
            return self._fit_late(explanation)
        return self._fit(explanation, explanation.fixed, None)

    def best_of(self, candidates: Sequence[RigExplanation]) -> FittedExplanation:
        """Return the fit of the most probable of alike explanations with fixed motions. They are
        compared with the disagreement of no cause that is most probable beside one of them.
        """
        sizes = np.full(2, DISCREPANCY[0])
        for _ in range(2):
            reduced = self._reduced_with((), sizes)
            motions = [_motion(reduced, candidate) for candidate in candidates]
            scores = [
                reduced.estimate(motion).log_evidence - math.log(candidate.rivals)
                for motion, candidate in zip(motions, candidates, strict=True)
            ]
            best = int(np.argmax(scores))
            fitted = self._fit(candidates[best], motions[best], None)
            sizes = fitted.sizes[-2:]
        return fitted

    def _fit_late(self, explanation: RigExplanation) -> FittedExplanation:
        """Fit a lateness: the motion of the board is that within it, and as uncertain."""
        lateness = MOMENT
        uncertainty: RandomMotion | None = None
        for _ in range(REPEATS):
            moved = self.context.motion.after(lateness)
            fixed = late_motion(self.context, explanation.camera, moved, lateness)
            fitted = self._fit(explanation, fixed, uncertainty)
            assert fitted.estimate
            lateness = float(fitted.estimate.value[0])
            if abs(lateness) < MOMENT * SMALLEST:
                break
            moved = self.context.motion.after(lateness)
            board = self.context.of_board(explanation.camera)
            uncertainty = RandomMotion(board, roots(moved.covariance), adapts=False)
        return fitted

    def _fit(
        self,
        explanation: RigExplanation,
        fixed: FixedMotion | None,
        uncertainty: RandomMotion | None,
    ) -> FittedExplanation:
        kind = explanation.random
        ranges = (*(kind.ranges if kind else ()), DISCREPANCY, DISCREPANCY)
        limits = np.log(np.array(ranges))
        certain = (uncertainty,) if uncertainty else ()

        def motions(sizes: Array) -> tuple[RandomMotion, ...]:
            if not kind:
                return certain
            scaled = zip(kind.shapes, sizes, strict=True)
            covariance = sum(shape * size**2 for shape, size in scaled)
            return (*certain, RandomMotion(kind.columns, roots(np.asarray(covariance))))

        def log_evidence(logs: Array) -> float:
            sizes = np.exp(np.clip(logs, limits[:, 0], limits[:, 1]))
            reduced = self._reduced_with(motions(sizes[:-2]), sizes[-2:])
            gain = reduced.estimate(fixed).log_evidence if fixed else 0.0
            return reduced.log_evidence + gain

        logs = _maximise(log_evidence, limits)
        sizes = np.exp(logs)
        sigmas, log_width = _widths(log_evidence, logs, limits)
        random = motions(sizes[:-2])
        reduced = self._reduced_with(random, sizes[-2:])
        return FittedExplanation(
            explanation=explanation,
            log_evidence=log_evidence(logs) + log_width - math.log(explanation.rivals),
            sizes=sizes,
            size_sigmas=sizes * sigmas,
            estimate=reduced.estimate(fixed) if fixed else None,
            fixed=fixed,
            random=random,
            discrepancy=self.context.discrepancy(sizes[-2:]),
        )

    def _reduced_with(self, random: tuple[RandomMotion, ...], discrepancy: Array) -> ReducedMotions:
        """Return the products beside a disagreement without a cause, of (2,) px."""
        motions = (*self.context.accepted, *random, *self.context.discrepancy(discrepancy))
        return ReducedMotions.of(self.context.products, motions)


def _motion(reduced: ReducedMotions, explanation: RigExplanation) -> FixedMotion:
    """Return the fixed motion of an explanation; of an effect of a camera or of the board, in its
    most probable form. The numbers of each form begin with those of the simpler ones.
    """
    motion, own_effect = explanation.fixed, explanation.own_effect
    assert motion
    if not own_effect:
        return motion
    tuned = own_effect.effect.tune(*reduced.marginal(motion))
    entries = own_effect.entries[: len(tuned.effect_parameters)]
    simpler = replace(own_effect, effect=tuned, entries=entries)
    return own_motion(simpler, len(motion.by_number))


def late_motion(
    context: RigContext, camera: str, moved: BoardDisplacement, lateness: float
) -> FixedMotion:
    """Return the motion of the board by a second of lateness, from that within a lateness."""
    return FixedMotion(
        context.of_board(camera), moved.mean[:, :, None] / lateness, np.array([LATENESS.sigma])
    )


def _maximise(function: Callable[[Array], float], limits: Array) -> Array:
    """Return the (k,) logarithms of the sizes with the largest evidence, within their limits."""
    width = limits[:, 1] - limits[:, 0]
    best: Array | None = None

    def cost(logs: Array) -> float:
        return -function(logs)

    for fraction in (0.35, 0.7):
        start = limits[:, 0] + fraction * width
        simplex = np.vstack([start, start + np.diag(0.25 * width)])
        solution = minimize(
            cost,
            start,
            method="Nelder-Mead",
            bounds=[(low, high) for low, high in limits.tolist()],
            options={"initial_simplex": simplex.tolist(), "xatol": 0.02, "fatol": 0.02},
        )
        if best is None or -solution.fun > function(best):
            best = np.clip(solution.x, limits[:, 0], limits[:, 1])
    assert best is not None
    return best


def _widths(function: Callable[[Array], float], logs: Array, limits: Array) -> tuple[Array, float]:
    """Return the (k,) standard deviations of the logarithms of the sizes, and the logarithm of the
    part of their ranges that is as probable.
    """
    middle = function(logs)
    sigmas = np.zeros(len(logs))
    log_width = 0.0
    for index, (low, high) in enumerate(limits):
        step = np.zeros(len(logs))
        step[index] = STEP
        below, above = function(logs - step), function(logs + step)
        curvature = (2 * middle - below - above) / STEP**2
        sigmas[index] = min(high - low, max(curvature, 1e-12) ** -0.5)
        if low + STEP < logs[index] < high - STEP:
            log_width += min(0.0, math.log(math.sqrt(2 * math.pi) * sigmas[index] / (high - low)))
    return sigmas, log_width
