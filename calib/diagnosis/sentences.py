"""What a diagnosis says in sentences."""

from collections.abc import Iterator, Sequence

from calib.diagnosis.nearest_effects import nearest_named
from calib.diagnosis.score_test import Optimum
from calib.diagnosis.selection import Loop, Trial
from calib.diagnosis.separating_view import separating_view
from calib.diagnosis.variance_split import Share
from calib.effects.effect import Effect
from calib.effects.free_field import FreeField
from calib.planning.hints import words

ABSORBED = 0.95
"""The part of an effect that the fitted numbers can imitate, from which it is said to be absorbed."""

SEPARATES = {
    "board_bow": "tilt the board by 40 degrees and more, in both directions, so that its middle and its edges lie at different depths",
    "board_scale": "turn the board by 90 degrees in half of the views",
    "free_field": "turn the board by 90 degrees in some views, and move it over the whole picture",
    "lens": "take pictures without the cover (bare/), and boards at very different depths",
    "focal": "tilt the board, and hold it near and far",
    "principal_point": "turn the camera, or the board, by 90 degrees in some views",
    "focal_drift": "take the same board pose at the beginning and at the end",
    "rolling_shutter": "hold the board still, or on a tripod, for some views",
    "flat_port": "hold the board near and far: what a window does depends on depth, what a lens does not",
    "cover_tilt": "hold the board as near as it fits into the picture",
    "cover_offset": "hold the board as near as it fits into the picture",
    "cover_radius": "hold the board as near as it fits into the picture",
    "thickness": "hold the board as near as it fits into the picture",
    "refractive_index": "measure the glass: views tell its index hardly from its thickness",
    "wedge": "hold the board as near as it fits into the picture, at its left and its right side",
    "inner_surface": "hold the board as near as it fits into the picture, where parallax tells the two surfaces apart",
    "fine_surface": "fill the place in question with corners: a board with smaller squares, or more views there",
    "detector_bias": "take sharper pictures, at a higher resolution",
}
"""What else tells an effect from its like, where no one pose of the board does."""
ELSE = "take views at other depths, tilts and turns of the board"
TELLS = 1.2
"""The factor on an effect's sigma from which a pose of the board is said to tell it from its like."""


def verdict(trial: Trial, *, taken: bool) -> str:
    """What became of a candidate."""
    if taken:
        return "found"
    if trial.columns.absorbed > ABSORBED:
        return "absorbed"
    if trial.joint and not trial.joint.finite:
        return "not finite"
    if not trial.gain:
        return "not asked for"
    if trial.passes:
        return "another helped more"
    if trial.large:
        return "fails at other depths"
    return "too small" if trial.confirmed else "not confirmed"


def remarks(loop: Loop, left: Sequence[Share], *, timed: bool) -> Iterator[str]:
    """What cannot be told, and what is left."""
    for effect in loop.model.effects:
        like = sorted(loop.confounded.get(effect.name, ()))
        if like:
            yield f"These views cannot tell {effect.name} from {' or '.join(like)}. {_separation(loop, effect, like)}"
        if isinstance(effect, FreeField):
            yield f"free_field has no name: it describes the error and mends it, but what causes it is not known. {_nearest(loop, effect)}"
    if not timed and any(effect.name == "focal_drift" for effect in loop.model.effects):
        yield "There are no times in frames.csv, so the order of the files stood for them."
    for share in left[:1]:
        yield (
            f"{100 * share.fraction:.0f} % of what is left goes with {share.organised_by}, where noise would give "
            f"{100 * share.chance:.0f} %: something there is not explained."
        )


def _separation(loop: Loop, effect: Effect, like: Sequence[str]) -> str:
    """What would tell an effect from its like."""
    present = {e.name for e in loop.model.effects}
    others = {name: trial.columns.effect for (name, _), trial in loop.trials.items() if name in like and name not in present}
    at = Optimum(loop.model, loop.observations, loop.joint)
    view = separating_view(at, loop.board, loop.camera, effect, tuple(others.values())) if others else None
    if view is None or view.shrinks < TELLS:
        return f"To separate them, {SEPARATES.get(effect.name, ELSE)}."
    where = words(view.pose, view.corners, (loop.camera.width, loop.camera.height), None, view.reach)
    turned = ", turned by 90 degrees" if view.turned else ""
    smaller = f"one such view makes the sigma of {effect.name} {view.shrinks:.1f} times smaller"
    return f"To separate them, hold the board {where}{turned}: {smaller}."


def _nearest(loop: Loop, effect: FreeField) -> str:
    """The named effects that can do part of what a field does."""
    without = loop.base.with_effects(e for e in loop.model.effects if e is not effect)
    joint = without.fitted(loop.observations, loop.joint.poses)
    named = [trial.columns.effect for trial in loop.trials.values() if not isinstance(trial.columns.effect, FreeField)]
    present = {e.name for e in loop.model.effects}
    near = nearest_named(Optimum(without, loop.observations, joint), effect, loop.joint.values, [e for e in named if e.name not in present])
    if not near:
        return "No named effect comes near it."
    return "Nearest to it: " + ", ".join(f"{name}, which can do {100 * share:.0f} % of it" for name, share in near) + "."
