"""The explanations of how the cameras of a rig disagree: each with its numbers, the evidence for
it, and how large it is.

Beside every explanation the cameras may disagree without a cause: each camera sees the board of
each placement a little elsewhere, by motions that shift its corners alike in all directions. What
the lens and the cover leave looks so. Without this rival, any random motion would be found in every
rig that is not perfect.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from calib.effects.effect import EACH_VIEW
from calib.effects.varying import FROM_VIEW
from calib.rig.board_motion import BoardMotion, Displacement
from calib.rig.motion_evidence import FixedEstimate, FixedMotion, RandomMotion, ReducedMotions
from calib.rig.motion_products import MotionProducts
from calib.rig.moved_cameras import KINDS, MIN_SLIP_PLACEMENTS, SHIFT_SPREAD, TURN_SPREAD
from calib.rig.rig_effects import (
    FLEX_SHIFT,
    FLEX_TURN,
    LATENESS,
    RIG_FLEX,
    RIG_SLIP,
    SYNC_OFFSET,
    RigEffect,
)
from calib.session import tolerances

DISCREPANCY = (1e-4, 10.0)
"""px: the range of a disagreement without a cause, root mean square over the corners."""
SMALLEST = 1e-4
"""The smallest size of a random motion, as a fraction of the largest."""
MOMENT = 1e-3
"""s: the time over which the speed of the board is taken before the lateness is known."""
STEP = 0.2
"""The step of the logarithm of a size by which the curvature of the evidence is taken."""
REPEATS = 3
"""The lateness and the uncertainty of the speeds depend on each other; each repeat leaves a
hundredth of the difference.
"""

Array = NDArray[np.float64]
Range = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class RandomKind:
    """Motions of one camera that each placement draws anew, by a few sizes."""

    columns: slice
    shapes: tuple[Array, ...]
    """For each size, the (P, k, k) covariance of the motions for a size of 1."""
    ranges: tuple[Range, ...]
    """For each size, its range."""


@dataclass(frozen=True, slots=True, eq=False)
class Explanation:
    """A candidate explanation."""

    effect: RigEffect | None
    """None for no cause."""
    camera: str = ""
    varies: str = ""
    """`each_view` for motions that each placement draws anew, `from_view` for a slip."""
    placement: int = -1
    """The first placement after a slip."""
    ways: int = 1
    """The number of explanations among which the prior odds of the effect are divided."""
    fixed: FixedMotion | None = None
    random: RandomKind | None = None
    is_late: bool = False
    """True for a constant lateness, whose effect depends on the speed of the board."""
    kind: str = ""
    """Of a slip: one of `KINDS`."""

    @property
    def name(self) -> str:
        return self.effect.name if self.effect else ""


@dataclass(frozen=True, slots=True, eq=False)
class FittedExplanation:
    """An explanation with its most probable numbers."""

    explanation: Explanation
    log_evidence: float
    """With the prior odds, up to a constant that all explanations of one search share."""
    sizes: Array
    """(k,) the sizes of the random motions; the last one is that of the disagreement without a
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


@dataclass(frozen=True, eq=False)
class RigContext:
    """What the explanations need: the linearised fit, and what is known of the board's motion."""

    products: MotionProducts
    compared: tuple[str, ...]
    """The cameras whose lateness the placements tell."""
    mounted: tuple[str, ...]
    """Those of them whose mounting the placements tell."""
    reference: str
    order: NDArray[np.int64]
    """(P,) the placements in the order of time, or of their names."""
    shared: NDArray[np.bool_]
    """(P,) true for a placement that two cameras saw."""
    motion: BoardMotion
    accepted: tuple[RandomMotion, ...] = ()
    """The random motions of effects that were found before."""

    @property
    def count(self) -> int:
        return len(self.products.products)

    def of_camera(self, name: str) -> slice:
        """Return the columns of a camera's own motion."""
        start = self.products.motions[name].start
        return slice(start, start + 6)

    def of_board(self, name: str) -> slice:
        """Return the columns of the motion of the board that a camera sees."""
        stop = self.products.motions[name].stop
        return slice(stop - 6, stop)

    @cached_property
    def discrepancies(self) -> tuple[tuple[slice, Array], ...]:
        """The columns and the (P, 6, 6) covariances of a disagreement of 1 px without a cause, for
        each camera but the reference.
        """
        result = []
        for name, information in self.products.board.items():
            if name != self.reference:
                corners = self.products.corners[name]
                covariance = np.zeros_like(information)
                seen = corners > 6
                covariance[seen] = np.linalg.inv(information[seen]) * (
                    corners[seen, None, None] / 6
                )
                result.append((self.of_board(name), covariance))
        return tuple(result)

    def discrepancy(self, size: float) -> tuple[RandomMotion, ...]:
        """Return the disagreement without a cause, of a size in px."""
        if size <= DISCREPANCY[0]:
            return ()
        return tuple(
            RandomMotion(columns, size * roots(covariance), adapts=False)
            for columns, covariance in self.discrepancies
        )


def roots(covariances: Array) -> Array:
    """Return (P, k, k) L with L L^T the (P, k, k) covariances, which may be singular."""
    values, vectors = np.linalg.eigh(covariances)
    return np.asarray(vectors * np.sqrt(values.clip(0))[:, None, :])


def explanations(context: RigContext) -> Iterator[Explanation]:
    """Yield every explanation that is possible, no cause first."""
    yield Explanation(None)
    cameras = len(context.compared)
    placements = context.count
    is_timed = bool(context.motion.bursts)
    for name in context.compared:
        board = context.of_board(name)
        if is_timed:
            yield Explanation(SYNC_OFFSET, name, ways=2 * cameras, is_late=True)
        yield Explanation(
            SYNC_OFFSET,
            name,
            varies=EACH_VIEW,
            ways=(1 + is_timed) * cameras,
            random=_turns_and_shifts(
                board, placements, tolerances.BOARD_SPIN.sigma, tolerances.BOARD_MOVE.sigma
            ),
        )
    for name in context.mounted:
        own = context.of_camera(name)
        yield Explanation(
            RIG_FLEX,
            name,
            varies=EACH_VIEW,
            ways=len(context.mounted),
            random=_turns_and_shifts(own, placements, FLEX_TURN.sigma, FLEX_SHIFT.sigma),
        )
        yield from _slips(context, name)


def _slips(context: RigContext, name: str) -> Iterator[Explanation]:
    """Yield the slips of a camera before each placement but the first."""
    order = context.order[context.shared[context.order]]
    if len(order) < MIN_SLIP_PLACEMENTS:
        return
    own = context.of_camera(name)
    spread = np.repeat([TURN_SPREAD, SHIFT_SPREAD], 3)
    moments = range(1, len(order))
    ways = len(context.mounted) * len(moments) * len(KINDS)
    for first in moments:
        after = np.zeros(context.count)
        after[order[first:]] = 1.0
        for kind, numbers in KINDS.items():
            by_number = after[:, None, None] * np.eye(6)[:, numbers]
            yield Explanation(
                RIG_SLIP,
                name,
                varies=FROM_VIEW,
                placement=int(order[first]),
                ways=ways,
                fixed=FixedMotion(own, by_number, spread[numbers]),
                kind=kind,
            )


def _turns_and_shifts(columns: slice, count: int, turn: float, shift: float) -> RandomKind:
    """Return random motions with one size for rotations (rad) and one for translations (m)."""
    shapes = []
    for size in (slice(0, 3), slice(3, 6)):
        shape = np.zeros((count, 6, 6))
        shape[:, range(6)[size], range(6)[size]] = 1.0
        shapes.append(shape)
    ranges = ((SMALLEST * turn, turn), (SMALLEST * shift, shift))
    return RandomKind(columns, tuple(shapes), ranges)


class Evaluator:
    """The evidence of explanations in one context."""

    def __init__(self, context: RigContext) -> None:
        self.context = context
        self._reduced: dict[float, ReducedMotions] = {}

    def fit(self, explanation: Explanation) -> FittedExplanation:
        """Return the most probable numbers of an explanation, and its evidence."""
        if explanation.is_late:
            return self._fit_late(explanation)
        return self._fit(explanation, explanation.fixed, None)

    def best_of(self, candidates: Sequence[Explanation]) -> FittedExplanation:
        """Return the fit of the most probable of alike explanations with fixed motions. They are
        compared with the disagreement of no cause that is most probable beside one of them.
        """
        size = DISCREPANCY[0]
        best = candidates[0]
        for _ in range(2):
            reduced = self.reduced(size)
            scores = [
                reduced.estimate(candidate.fixed).log_evidence
                for candidate in candidates
                if candidate.fixed
            ]
            best = candidates[int(np.argmax(scores))]
            fitted = self.fit(best)
            size = float(fitted.sizes[-1])
        return fitted

    def reduced(self, discrepancy: float) -> ReducedMotions:
        """Return the products beside a disagreement without a cause, px."""
        if discrepancy not in self._reduced:
            motions = (*self.context.accepted, *self.context.discrepancy(discrepancy))
            self._reduced[discrepancy] = ReducedMotions.of(self.context.products, motions)
        return self._reduced[discrepancy]

    def _fit_late(self, explanation: Explanation) -> FittedExplanation:
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
        explanation: Explanation,
        fixed: FixedMotion | None,
        uncertainty: RandomMotion | None,
    ) -> FittedExplanation:
        kind = explanation.random
        ranges = (*(kind.ranges if kind else ()), DISCREPANCY)
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
            reduced = self._reduced_with(motions(sizes[:-1]), float(sizes[-1]))
            gain = reduced.estimate(fixed).log_evidence if fixed else 0.0
            return reduced.log_evidence + gain

        logs = _maximise(log_evidence, limits)
        sizes = np.exp(logs)
        sigmas, log_width = _widths(log_evidence, logs, limits)
        random = motions(sizes[:-1])
        reduced = self._reduced_with(random, float(sizes[-1]))
        return FittedExplanation(
            explanation=explanation,
            log_evidence=log_evidence(logs) + log_width - math.log(explanation.ways),
            sizes=sizes,
            size_sigmas=sizes * sigmas,
            estimate=reduced.estimate(fixed) if fixed else None,
            fixed=fixed,
            random=random,
            discrepancy=self.context.discrepancy(float(sizes[-1])),
        )

    def _reduced_with(self, random: tuple[RandomMotion, ...], discrepancy: float) -> ReducedMotions:
        if not random:
            return self.reduced(discrepancy)
        motions = (*self.context.accepted, *random, *self.context.discrepancy(discrepancy))
        return ReducedMotions.of(self.context.products, motions)


def late_motion(
    context: RigContext, camera: str, moved: Displacement, lateness: float
) -> FixedMotion:
    """Return the motion of the board by a second of lateness, from that within a lateness."""
    return FixedMotion(
        context.of_board(camera), moved.mean[:, :, None] / lateness, np.array([LATENESS.sigma])
    )


def _maximise(function: Callable[[Array], float], limits: Array) -> Array:
    """Return the (k,) logarithms of the sizes with the largest evidence, within their limits."""
    width = limits[:, 1] - limits[:, 0]
    best: Array | None = None
    for part in (0.35, 0.7):
        start = limits[:, 0] + part * width
        simplex = np.vstack([start, start + np.diag(0.25 * width)])
        solution = minimize(
            lambda logs: -function(logs),
            start,
            method="Nelder-Mead",
            bounds=limits.tolist(),
            options={"initial_simplex": simplex, "xatol": 0.02, "fatol": 0.02},
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


def with_accepted(context: RigContext, fitted: FittedExplanation) -> RigContext:
    """Return the context with the random motions of an accepted explanation."""
    return replace(context, accepted=(*context.accepted, *fitted.random))
