"""The backward pass of the loop: effects that the others have made idle are dropped."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from calib.diagnosis.agreement import agreement
from calib.diagnosis.held_out import gain
from calib.diagnosis.trial import LEAST_GAIN, Fit, worth
from calib.effects.effect import Effect
from calib.estimation.joint_fit import ROUNDS

if TYPE_CHECKING:
    from calib.diagnosis.selection import Loop

NEEDED = 0.05
"""p-value from which an accepted effect counts as needed beside those that came after it."""
PLAINLY = 3.0
"""Times the least gain: what is taken off the error by an effect that is needed without asking
held-out views.
"""
OF_ONE_MIND = 6.0
"""Standard deviations of the views' disagreement, from which they are not asked."""


def drop_idle(loop: Loop, newest: Effect | None = None) -> bool:
    """Drop what is no longer needed, the oldest first, and say whether there was any; the newest
    has just been asked for. What parameters of every view do as well is not dropped for it: an
    effect for all views is judged beside its like only, unless the corners are more probable
    without it, those parameters integrated out.
    """
    before = loop.dropped.copy()
    for effect in loop.model.effects:
        if effect is newest or _surely_needed(loop, effect, loop.model.effects):
            continue
        private = loop.model.path.has_private_blocks and not effect.per_view
        idle = not private and _idle(loop, effect)
        if not (idle or private):
            continue
        fewer = loop.with_only(_others(effect, loop.model.effects))
        joint = fewer.model.fit(loop.observations, fewer.joint.poses, fewer.joint.start, ROUNDS)
        if joint.finite and (
            idle or joint.log_marginal > loop.joint.log_marginal or _idle(loop, effect)
        ):
            loop.go_on_with(Fit(fewer.model, joint))
            loop.dropped.add(effect.name)
    return loop.dropped != before


def _surely_needed(loop: Loop, effect: Effect, beside: Sequence[Effect]) -> bool:
    """Whether views need not be held out to know that it is needed beside others: fits without it
    are worse, and so much that the views are of one mind.
    """
    with_it, without = loop.with_only(beside), loop.with_only(_others(effect, beside))
    apart = with_it.joint.log_marginal - without.joint.log_marginal
    raised = (without.joint.cost / with_it.joint.cost) ** 0.5 - 1
    return (
        raised > PLAINLY * LEAST_GAIN
        and agreement(with_it, without, apart, loop.observations) > OF_ONE_MIND
    )


def _idle(loop: Loop, effect: Effect) -> bool:
    """Whether held-out views do without it beside its like."""
    beside = [e for e in loop.model.effects if effect.per_view or not e.per_view]
    if _surely_needed(loop, effect, beside):
        return False
    half = any(e.per_view for e in beside)
    left = (
        loop.left() if len(beside) == len(loop.model.effects) else loop.left_of(beside, half=half)
    )
    lost = gain(loop.left_of(_others(effect, beside), half=half), left)
    return min(lost.p_value, lost.presence) > NEEDED or not worth(lost)


def _others(effect: Effect, effects: Sequence[Effect]) -> list[Effect]:
    return [e for e in effects if e is not effect]
