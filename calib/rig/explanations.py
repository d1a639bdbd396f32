"""The explanations of how the cameras of a rig disagree: each with its numbers, the evidence for
it, and how large it is.

Beside every explanation the cameras may disagree without a cause: errors of the corners let each
camera see the board of each placement a little elsewhere. Some have no pattern, some are nearly the
same all over the board, as what vibration, readout and lens leave. Without this rival, any random
motion would be found in every rig that is not perfect: two measured pairs of cameras seemed to
flex.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.effects.effect import BLOCK_SCALES, EACH_VIEW
from calib.effects.varying import FROM_VIEW
from calib.rig.motion_evidence import FixedMotion
from calib.rig.moved_cameras import KINDS, MIN_SLIP_PLACEMENTS, SHIFT_SPREAD, TURN_SPREAD
from calib.rig.own_effects import OwnEffect
from calib.rig.rig_context import RigContext
from calib.rig.rig_effects import (
    BOARD_FLEX,
    FLEX_SHIFT,
    FLEX_TURN,
    RIG_FLEX,
    RIG_SLIP,
    ROLLING_SHUTTER,
    SYNC_OFFSET,
    RigEffect,
)
from calib.session import tolerances

SMALLEST = 1e-4
"""The smallest size of a random motion, as a fraction of the largest."""
Array = NDArray[np.float64]
Range = tuple[float, float]


@dataclass(frozen=True, slots=True, eq=False)
class RandomKind:
    """Motions of cameras or of the board, or bends of it, that each placement draws anew, by a few
    sizes.
    """

    columns: slice | NDArray[np.int64]
    shapes: tuple[Array, ...]
    """For each size, the (P, k, k) covariance of the motions for a size of 1."""
    ranges: tuple[Range, ...]
    """For each size, its range."""


@dataclass(frozen=True, slots=True, eq=False)
class RigExplanation:
    """A candidate explanation."""

    effect: RigEffect | None
    """None for no cause."""
    camera: str = ""
    varies: str = ""
    """`each_view` for motions that each placement draws anew, `from_view` for a slip."""
    placement: int = -1
    """The first placement after a slip."""
    rivals: int = 1
    """The number of explanations among which the prior odds of the effect are divided."""
    fixed: FixedMotion | None = None
    random: RandomKind | None = None
    is_late: bool = False
    """True for a constant lateness, whose effect depends on the speed of the board."""
    interval_s: float = math.nan
    """s, the interval between the placements of a burst, for a constant lateness."""
    kind: str = ""
    """One of `KINDS` for a slip."""
    own_effect: OwnEffect | None = None
    """An effect of one camera, or of the board; then `camera` may be empty."""

    @property
    def name(self) -> str:
        return self.effect.name if self.effect else ""

    @property
    def is_of_bends(self) -> bool:
        """True for a bend of the board in each placement."""
        return self.effect is BOARD_FLEX

    @property
    def subject(self) -> str:
        """The end of "an effect of ..."."""
        return self.camera or ("all cameras" if self.effect is ROLLING_SHUTTER else "the board")


def explanations(context: RigContext) -> Iterator[RigExplanation]:
    """Yield every explanation that is possible, no cause first."""
    yield RigExplanation(None)
    cameras = len(context.compared)
    placements = context.count
    is_timed = bool(context.motion.bursts)
    for name in context.compared:
        board = context.of_board(name)
        if is_timed:
            yield RigExplanation(
                SYNC_OFFSET,
                name,
                rivals=2 * cameras,
                is_late=True,
                interval_s=context.motion.interval_s,
            )
        yield RigExplanation(
            SYNC_OFFSET,
            name,
            varies=EACH_VIEW,
            rivals=(1 + is_timed) * cameras,
            random=_turns_and_shifts(
                board, placements, tolerances.BOARD_SPIN.sigma, tolerances.BOARD_MOVE.sigma
            ),
        )
    if context.board_flex:
        yield _board_flex(context)
    yield from _rolling_shutters(context)
    yield from _own(context)
    for name in context.mounted:
        columns = context.of_camera(name)
        yield RigExplanation(
            RIG_FLEX,
            name,
            varies=EACH_VIEW,
            rivals=len(context.mounted),
            random=_turns_and_shifts(columns, placements, FLEX_TURN.sigma, FLEX_SHIFT.sigma),
        )
        yield from _slips(context, name)


def _board_flex(context: RigContext) -> RigExplanation:
    """Return a bend of the board in each placement, which all cameras see."""
    shape = np.tile(np.diag(context.bend_sigmas**2), (context.count, 1, 1))
    kind = RandomKind(context.products.bends, (shape,), ((BLOCK_SCALES[0], BLOCK_SCALES[-1]),))
    return RigExplanation(BOARD_FLEX, varies=EACH_VIEW, random=kind)


def _rolling_shutters(context: RigContext) -> Iterator[RigExplanation]:
    """Yield a motion of the board during the readout: of all cameras that may have a rolling
    shutter, which see the same motion, and of each of them.
    """
    names = tuple(context.readouts)
    groups = [names] if len(names) > 1 else []
    groups += [(name,) for name in names]
    for group in groups:
        readouts = np.array([context.readouts[name] for name in group])
        ratios = readouts / readouts.max()
        motions = _turns_and_shifts(
            slice(0, 6), context.count, tolerances.BOARD_SPIN.sigma, tolerances.BOARD_MOVE.sigma
        )
        alike = np.outer(ratios, ratios)
        kind = RandomKind(
            context.of_readouts(group),
            tuple(np.asarray(np.kron(alike, shape)) for shape in motions.shapes),
            motions.ranges,
        )
        camera = group[0] if len(group) == 1 else ""
        yield RigExplanation(
            ROLLING_SHUTTER, camera, varies=EACH_VIEW, rivals=len(groups), random=kind
        )


def _own(context: RigContext) -> Iterator[RigExplanation]:
    """Yield the effects of single cameras and of the board."""
    for own_effect in context.wide.own_effects:
        effect = own_effect.effect
        yield RigExplanation(
            RigEffect(effect.name, effect.description, effect.advice),
            own_effect.camera,
            rivals=len(context.wide.motions) if own_effect.camera else 1,
            fixed=own_motion(own_effect, context.count),
            own_effect=own_effect,
        )


def own_motion(own_effect: OwnEffect, placements: int) -> FixedMotion:
    """Return an effect of a camera or of the board as a change by its numbers."""
    by_number = np.tile(np.eye(len(own_effect.entries)), (placements, 1, 1))
    return FixedMotion(own_effect.entries, by_number, own_effect.spread)


def _slips(context: RigContext, name: str) -> Iterator[RigExplanation]:
    """Yield the slips of a camera before each placement but the first."""
    order = context.order[context.shared[context.order]]
    if len(order) < MIN_SLIP_PLACEMENTS:
        return
    columns = context.of_camera(name)
    spread = np.repeat([TURN_SPREAD, SHIFT_SPREAD], 3)
    moments = range(1, len(order))
    rivals = len(context.mounted) * len(moments) * len(KINDS)
    for first in moments:
        sign = np.zeros(context.count)
        sign[order[:first]] = -1.0  # the rig's own mounting is that after the slip
        for kind, numbers in KINDS.items():
            by_number = sign[:, None, None] * np.eye(6)[:, numbers]
            yield RigExplanation(
                RIG_SLIP,
                name,
                varies=FROM_VIEW,
                placement=int(order[first]),
                rivals=rivals,
                fixed=FixedMotion(columns, by_number, spread[numbers]),
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
