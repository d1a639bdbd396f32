"""The sentences of a diagnosis."""

from collections.abc import Iterator, Sequence

import numpy as np
import torch

from calib.diagnosis.nearest_effects import nearest_named
from calib.diagnosis.printed_patterns import ClosedForm, closed_forms
from calib.diagnosis.search_state import SearchState
from calib.diagnosis.separating_view import separating_view
from calib.diagnosis.trial import ALPHA, MIN_GAIN, Trial
from calib.effects.description import describe_media
from calib.effects.effect import Effect, is_possible
from calib.effects.fine_surface import FineSurface
from calib.effects.free_field import FreeField
from calib.effects.varying import WITH_TIME, CameraOfView, Varying
from calib.fit_record.history import Family
from calib.inference.effect_context import point_on_glass
from calib.inference.fitted_model import FittedModel
from calib.inference.residual_structure import ORGANISER_WORDS, VarianceShare
from calib.inference.score_test import ScoreTest
from calib.io.numerals import counted
from calib.optics.relief import Bump
from calib.planning.hints import placement_hint
from calib.rounding import with_sigma

ABSORBED = 0.95
"""The fraction of an effect that the fitted parameters can imitate above which it is absorbed."""
MIN_FORMULA_FRACTION = 0.5
"""The smallest fraction of a field that a reported formula explains; noise alone gives up to a
fifth (tests/diagnosis/test_printed_patterns).
"""
MAX_SCORED = 3
"""The number of effects that are reported by their scores alone."""
MIN_SIGMA_FACTOR = 1.2
"""The smallest factor on an effect's sigma of a pose that is proposed for separating effects."""


def trial_verdict(trial: Trial, *, accepted: bool) -> str:
    """Return the outcome of a candidate in a few words."""
    if accepted:
        return "found"
    if trial.test.absorbed > ABSORBED:
        return "absorbed"
    if not trial.gain:
        if not trial.fit:
            return "not asked for"
        if not trial.fit.joint.finite:
            return "not finite"
        if trial.impossible:
            return "not possible"
        if trial.improbable:
            return "too many numbers for what it explains"
        return "another helped more" if trial.error_decrease > MIN_GAIN else "too small"
    if trial.passes:
        return "another helped more"
    if trial.large:
        return "fails at other depths"
    return "too small" if trial.confirmed else "not confirmed"


def remarks(
    state: SearchState,
    families: Sequence[Family],
    formulas: Sequence[ClosedForm],
    structure: Sequence[VarianceShare],
    *,
    timed: bool,
) -> Iterator[str]:
    """Yield sentences on effects that these views cannot separate, and on unexplained structure."""
    yield from map(str, families)
    in_families = {name for family in families for name in family.members}
    present = {effect.name for effect in state.model.effects}
    candidates = {effect.name: effect for effect in _possible_candidates(state)}
    for effect in state.model.effects:
        confounded = state.confounded.get(effect.name, frozenset())
        similar = sorted(confounded & (candidates.keys() | present))
        if similar and effect.name not in in_families:
            absent = [candidates[name] for name in similar if name not in present]
            yield (
                f"These views cannot tell {effect.name} from {' or '.join(similar)}."
                f" {separation(state, effect, absent)}"
            )
        if not effect.has_cause:
            yield (
                "free_field has no name: it describes and corrects the error, but its cause is"
                f" not known. {_nearest_effects(state, effect)}"
            )
            yield from map(str, formulas[:1])
    for effect in state.model.effects:
        if isinstance(effect, Varying | CameraOfView):
            yield _state_of_maps(effect, state.fitted_model.observations.names)
    for effect in state.model.effects:
        if isinstance(effect, FineSurface) and isinstance(effect.relief, Bump):
            yield _describe_bump(state, effect.relief)
    if not timed and any(effect.varies == WITH_TIME for effect in state.model.effects):
        yield "frames.csv has no times, so the order of the files was used instead."
    for share in structure[:1]:
        yield (
            f"{100 * share.fraction:.0f} % of the remaining error follows"
            f" {ORGANISER_WORDS[share.organised_by]}, where noise alone gives"
            f" {100 * share.chance:.0f} %: something there is not explained."
        )


def _state_of_maps(effect: Varying | CameraOfView, views: Sequence[str]) -> str:
    """Return a sentence that says which values of numbers that differ the maps have."""
    if isinstance(effect, Varying) and effect.is_medium:
        return describe_media(effect, views)
    if isinstance(effect, Varying) and effect.settled:
        return f"The maps are of {effect.plain_numbers} at the end of the session."
    return f"The maps are of the mean of {effect.plain_numbers} over the views."


def _describe_bump(state: SearchState, bump: Bump) -> str:
    """Return a sentence with the place of a bump on the glass, as the camera sees it."""
    numbers = np.array([float(state.joint.values[param.name]) for param in bump.params])
    height, width = numbers[0], numbers[3]
    sigma = float(state.joint.sigma_of(bump.params[0].name))
    middle = np.array(bump.place) + numbers[1:3] / bump.metres
    x, y, _ = (1e3 * point_on_glass(state.fitted_model, torch.from_numpy(middle))).tolist()
    kind = "bump" if height > 0 else "dent"
    size = with_sigma(abs(1e6 * height), 1e6 * sigma)
    return (
        f"There is a {kind} of {size} um on the outer surface, such as a drop, dirt or a scratch:"
        f" clean the glass {abs(y):.1f} mm {'below' if y > 0 else 'above'} the optical axis and"
        f" {abs(x):.1f} mm to its {'right' if x > 0 else 'left'}, as the camera sees it. It is"
        f" {2e3 * width:.1f} mm wide."
    )


def _possible_candidates(state: SearchState) -> list[Effect]:
    """Return the tried effects that are possible in the current model; an effect on a window that
    was dropped is not.
    """
    effects = [trial.test.effect for trial in state.trials.values()]
    return [effect for effect in effects if is_possible(effect, state.model.path)]


def printed_forms(state: SearchState) -> list[ClosedForm]:
    """Return the closed forms that explain much of an accepted free field."""
    points = state.problem.board.points()
    forms = []
    for effect in state.model.effects:
        if isinstance(effect, FreeField):
            x, y = torch.from_numpy(points).unbind(-1)
            shift = effect.shift_corners(x, y, state.joint.values)
            shifts = torch.stack([shift.shift_x, shift.shift_y], -1).numpy()
            forms += closed_forms(points, shifts, state.problem.board.square)
    return [form for form in forms if form.explains > MIN_FORMULA_FRACTION]


def unconfirmed_scores(tests: Sequence[ScoreTest], views: int, required: int) -> tuple[str, ...]:
    """Return a sentence on the scores of a session with too few views to confirm an effect."""
    alpha = ALPHA / max(1, len(tests))
    significant = [
        test
        for test in tests
        if test.p_value < alpha and test.promises > MIN_GAIN and test.absorbed < ABSORBED
    ]
    significant.sort(key=lambda test: test.promises)
    best = {test.effect.name: test for test in significant}  # the best form of each effect
    start = f"With {counted(views, 'view')} nothing can be confirmed on held-out views"
    text = f"{start}: take {required} or more."
    if not best:
        return (f"{text} No effect's score stands out.",)
    descriptions = [
        f"{name} (error down by up to {100 * test.promises:.0f} %)"
        for name, test in reversed(best.items())
    ]
    listed = ", ".join(descriptions[:MAX_SCORED])
    return (f"{text} Not confirmed, by their scores alone: {listed}.",)


def separation(state: SearchState, effect: Effect, rivals: Sequence[Effect]) -> str:
    """Return the advice that separates an effect of the model from others that are not in it."""
    camera = state.problem.camera
    # No pose of the board separates parameters of single views.
    separable = (
        rivals and effect.effect_parameters and all(rival.effect_parameters for rival in rivals)
    )
    view = None
    if separable:
        view = separating_view(state.fitted_model, state.problem.board, camera, effect, rivals)
    if view is None or view.sigma_factor < MIN_SIGMA_FACTOR:
        return f"To separate them, {effect.advice}."
    place = placement_hint(
        view.pose, view.corners, (camera.width, camera.height), None, view.depth_range
    )
    turn = ", turned by 90 degrees" if view.turned else ""
    return (
        f"To separate them, hold the board {place}{turn}: one such view makes the sigma of"
        f" {effect.name} {view.sigma_factor:.1f} times smaller."
    )


def _nearest_effects(state: SearchState, field: Effect) -> str:
    """Return a sentence on the named effects that explain part of a free field."""
    base = state.evaluations.refit_without(field)
    present = {effect.name for effect in state.model.effects}
    absent = [
        effect
        for effect in _possible_candidates(state)
        if effect.has_cause and effect.name not in present
    ]
    fitted = FittedModel(base.model, state.problem.observations, base.joint)
    nearest = nearest_named(fitted, field, state.joint.values, absent)
    if not nearest:
        return "No named effect comes near it."
    effects = ", ".join(
        f"{name}, which explains {100 * share:.0f} % of it" for name, share in nearest
    )
    return f"Nearest to it: {effects}."
