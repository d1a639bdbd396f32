"""What a diagnosis says in sentences."""

from collections.abc import Iterator, Sequence

import torch

from calib.diagnosis.closed_forms import ClosedForm, closed_forms
from calib.diagnosis.finding import Family
from calib.diagnosis.nearest_effects import nearest_named
from calib.diagnosis.score_test import Optimum, ScoreTest
from calib.diagnosis.selection import Loop
from calib.diagnosis.separating_view import separating_view
from calib.diagnosis.trial import ALPHA, LEAST_GAIN, Trial
from calib.diagnosis.variance_split import Share
from calib.effects.effect import Effect, is_possible
from calib.effects.free_field import FreeField
from calib.planning.hints import placement_hint

ABSORBED = 0.95
"""The part of an effect that the fitted parameters can imitate, from which it is said to be
absorbed.
"""

MUCH = 0.5
"""The part of a field that a formula must be, to be worth a word: noise alone makes up to a fifth
(tests/diagnosis/test_closed_forms).
"""
SCORED = 3
"""Effects that are named by their scores alone."""
TELLS = 1.2
"""The factor on an effect's sigma from which a pose of the board is said to tell it from its like.
"""


def verdict(trial: Trial, *, taken: bool) -> str:
    """What became of a candidate."""
    if taken:
        return "found"
    if trial.test.absorbed > ABSORBED:
        return "absorbed"
    if not trial.gain:
        if not trial.fit:
            return "not asked for"
        if not trial.fit.joint.finite:
            return "not finite"
        if trial.improbable:
            return "too many numbers for what it explains"
        return "another helped more" if trial.lowers > LEAST_GAIN else "too small"
    if trial.passes:
        return "another helped more"
    if trial.large:
        return "fails at other depths"
    return "too small" if trial.confirmed else "not confirmed"


def remarks(
    loop: Loop,
    families: Sequence[Family],
    formulas: Sequence[ClosedForm],
    left: Sequence[Share],
    *,
    timed: bool,
) -> Iterator[str]:
    """What cannot be told, and what is left."""
    yield from map(str, families)
    told = {name for family in families for name in family.members}
    for effect in loop.model.effects:
        present = {e.name for e in loop.model.effects}
        asked = {e.name: e for e in _asked(loop)}
        like = sorted(loop.confounded.get(effect.name, set()) & (asked.keys() | present))
        if like and effect.name not in told:
            others = {name: asked[name] for name in like if name not in present}
            yield (
                f"These views cannot tell {effect.name} from {' or '.join(like)}."
                f" {separation(loop, effect, tuple(others.values()))}"
            )
        if not effect.has_cause:
            yield (
                "free_field has no name: it describes the error and mends it, but what causes it"
                f" is not known. {_nearest(loop, effect)}"
            )
            yield from map(str, formulas[:1])
    if not timed and any(effect.name == "focal_drift" for effect in loop.model.effects):
        yield "There are no times in frames.csv, so the order of the files stood for them."
    for share in left[:1]:
        yield (
            f"{100 * share.fraction:.0f} % of what is left goes with {share.organised_by}, where"
            f" noise would give {100 * share.chance:.0f} %: something there is not explained."
        )


def _asked(loop: Loop) -> list[Effect]:
    """The effects that were asked about and that there can be in the model as it is: one on a
    window that was dropped is none.
    """
    every = (trial.test.effect for trial in loop.trials.values())
    return [effect for effect in every if is_possible(effect, loop.model.path)]


def formulas_of(loop: Loop) -> list[ClosedForm]:
    """The closed forms that are much of an accepted free field."""
    fields = [effect for effect in loop.model.effects if isinstance(effect, FreeField)]
    points = loop.board.points()
    x, y = torch.from_numpy(points).unbind(-1)
    moved = [field.shift_corners(x, y, loop.joint.values) for field in fields]
    near = [
        closed_forms(points, torch.stack([one.shift_x, one.shift_y], -1).numpy(), loop.board.square)
        for one in moved
    ]
    return [form for forms in near for form in forms if form.explains > MUCH]


def unconfirmed_scores(scores: Sequence[ScoreTest], views: int, needed: int) -> tuple[str, ...]:
    """What the scores alone say of a session that has too few views to confirm anything."""
    alpha = ALPHA / max(1, len(scores))
    strong = [
        s for s in scores if s.p_value < alpha and s.promises > LEAST_GAIN and s.absorbed < ABSORBED
    ]
    best = {
        s.effect.name: s for s in sorted(strong, key=lambda s: s.promises)
    }  # of an effect's forms, the one that promises most
    said = f"With {views} views nothing can be confirmed on held-out ones: take {needed} or more."
    if not best:
        return (f"{said} No effect's score stands out.",)
    named = [
        f"{name} (error down by up to {100 * one.promises:.0f} %)"
        for name, one in reversed(best.items())
    ]
    return (f"{said} Not confirmed, by their scores alone: {', '.join(named[:SCORED])}.",)


def separation(loop: Loop, effect: Effect, others: Sequence[Effect]) -> str:
    """What would tell an effect of the model from others that are not in it."""
    at = Optimum(loop.model, loop.observations, loop.joint)
    asked = effect.effect_parameters and all(
        other.effect_parameters for other in others
    )  # what single views have for themselves, no pose tells
    view = (
        separating_view(at, loop.board, loop.camera, effect, others) if others and asked else None
    )
    if view is None or view.shrinks < TELLS:
        return f"To separate them, {effect.advice}."
    where = placement_hint(
        view.pose, view.corners, (loop.camera.width, loop.camera.height), None, view.reach
    )
    turned = ", turned by 90 degrees" if view.turned else ""
    smaller = f"one such view makes the sigma of {effect.name} {view.shrinks:.1f} times smaller"
    return f"To separate them, hold the board {where}{turned}: {smaller}."


def _nearest(loop: Loop, effect: Effect) -> str:
    """The named effects that can do part of what a field does."""
    without = loop.with_only([e for e in loop.model.effects if e is not effect])
    named = [effect for effect in _asked(loop) if effect.has_cause]
    present = {e.name for e in loop.model.effects}
    near = nearest_named(
        Optimum(without.model, loop.observations, without.joint),
        effect,
        loop.joint.values,
        [e for e in named if e.name not in present],
    )
    if not near:
        return "No named effect comes near it."
    return (
        "Nearest to it: "
        + ", ".join(f"{name}, which can do {100 * share:.0f} % of it" for name, share in near)
        + "."
    )
