"""Checks: the declared medium, and the index of the glass beside it. If every number is known, the
smooth cover is also tried with the other medium, air or water; else the fit has compared the two
(`calib.fitting.other_medium`).
"""

import math
from collections.abc import Iterator
from functools import lru_cache

from calib.calibration import Calibration
from calib.effects.varying import Varying
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import residuals
from calib.inference.media_of_views import views_in_other_medium
from calib.optics.build import covered_path
from calib.session.parameter_names import INDEX, number_of
from calib.session.schema import Number
from calib.session.shapes.layer import MEDIA, WATER, medium_word, opposite_medium
from calib.session.tolerances import ANY_WATER
from calib.verdict.case import Case
from calib.verdict.cover_stage import is_refuted
from calib.verdict.differing_views import find_differing
from calib.verdict.thresholds import OTHER_MEDIUM, OTHER_MEDIUM_LOG_ODDS, SAME_INDEX
from calib.verdict.verdict import Reason, Trust

UNDECIDED_LOG_ODDS = 3.0
"""The log odds of the stated medium below which the views do not tell it."""
MAX_POWER = 100
"""The largest power of ten in a sentence on odds."""


def medium(case: Case) -> Iterator[Reason]:
    cover, bare_error = case.rms_px.get("cover", 0.0), case.rms_px["pinhole"]
    declared = case.calibration.declared
    stated = declared.cover.medium
    if not stated:
        return
    if case.has_unknown:
        if not is_refuted(case):  # in no medium does a cover of the wrong shape fit
            yield from _more_probable(case, stated.value)
        return
    if cover <= max(OTHER_MEDIUM * bare_error, case.left_px):  # it is right
        return
    effects = [added.effect for added in case.calibration.effects]
    if any(isinstance(effect, Varying) and effect.is_medium for effect in effects):
        return
    index = stated.value
    name = opposite_medium(index)
    is_other = views_in_other_medium(case.optimum)
    if is_other is not None:
        differing = find_differing(case.calibration)
        if not (differing and differing.first.group.is_medium):  # then that is said
            sentence = (
                f"about {is_other.sum()} of the {len(is_other)} pictures seem to have been taken in"
                f" {name}, the others in {medium_word(index)}, as declared: {case.next.diagnosis}"
                " says which. Keep the pictures of each medium in a session of its own."
            )
            yield Reason(sentence, case.next.diagnose(), (declared.cover.medium_name,))
        return
    error = _error_in(case.calibration, name)
    if error < OTHER_MEDIUM * cover:
        sentence = (
            f"with {name} outside of the cover, the error with the numbers of"
            f" {case.next.description} is {error:.3f} px; with its outside_index of {index:g} it is"
            f" {cover:.3f} px. So the board was in {name}: {case.next.name_medium(MEDIA[name])}."
        )
        command = case.next.fit_in(MEDIA[name])
        yield Reason(sentence, command, (declared.cover.medium_name,))


def implausible_indices(case: Case) -> Iterator[Reason]:
    """Check that the declared index of the glass is not that of the medium outside."""
    cover = case.calibration.declared.cover
    indices = {name: n for name, n in cover.numbers.items() if number_of(name) == INDEX}
    outside = cover.medium
    if not (indices and outside) or any(n.unknown for n in (*indices.values(), outside)):
        return
    glass = max(indices, key=lambda name: indices[name].value)
    glass_index, outside_index = indices[glass].value, outside.value
    suspects = glass, cover.medium_name
    stated = (
        f"the glass is declared with the index {glass_index:g}, and what is outside with"
        f" {outside_index:g}"
    )
    if outside_index > glass_index:
        yield Reason(f"{stated}: are the two swapped?", case.next.fit(), suspects)
    elif abs(glass_index - MEDIA[WATER]) < SAME_INDEX:
        sentence = (
            f"{stated}: the index of the glass is that of water. Write that of the glass, such as"
            f" 1.49 for acrylic, and for water outside of it outside_index: {MEDIA[WATER]:g}."
        )
        yield Reason(sentence, case.next.fit(), suspects)


def undecided_medium(case: Case) -> Iterator[str]:
    """Yield a note where the other medium explains the views about as well."""
    stated = case.calibration.declared.cover.medium
    odds = case.calibration.outcome.medium_log_odds
    if not (stated and odds):
        return
    word, name = medium_word(stated.value), opposite_medium(stated.value)
    if -OTHER_MEDIUM_LOG_ODDS < odds[word] - odds[name] < UNDECIDED_LOG_ODDS:
        yield (
            f"these pictures fit {name} outside of the cover about as well as {word}. If you know"
            f" that it was {word}, ignore this. If it was {name}, the numbers of camera and cover"
            f" are wrong: {case.next.name_medium(MEDIA[name])}. If you do not know, pictures"
            " without the cover, in bare/, decide."
        )


def _more_probable(case: Case, stated: float) -> Iterator[Reason]:
    """Yield the reason that the other medium is far more probable, by the fit's comparison."""
    odds = case.calibration.outcome.medium_log_odds or {}
    log_odds = -odds.get(medium_word(stated), 0.0)
    if log_odds <= OTHER_MEDIUM_LOG_ODDS:
        return
    name = max(odds, key=odds.__getitem__)
    power = int(log_odds / math.log(10))
    times = f"10^{power}" if power < MAX_POWER else f"more than 10^{MAX_POWER}"
    sentence = (
        f"the pictures do not fit this cover with {medium_word(stated)} outside of it. Either they"
        f" were taken in {name} ({times} times as probable): {case.next.name_medium(MEDIA[name])}."
    )
    if case.tried_all_shapes:
        sentence += f" Or {case.other_shape}."
    else:
        sentence += (
            f" Or the cover has another shape or size than declared: try {case.next.unknown_cover}."
        )
    suspects = (case.calibration.declared.cover.medium_name,)
    command = case.next.fit_in(MEDIA[name])
    yield Reason(sentence, command, suspects, Trust.DO_NOT_USE)


def water_advice(case: Case) -> str:
    """Return what to write if the water outside has another index than declared; empty if the fit
    estimated it, if it is declared as exact, or if air is outside.
    """
    stated = case.calibration.declared.cover.medium
    if not stated or stated.exact or stated.sigma or medium_word(stated.value) != WATER:
        return ""
    return (
        f" Or the water has another index than {stated.value:g}, which was not fitted (the sea has"
        f" 1.34): {case.next.name_medium(stated.value, ANY_WATER.sigma)}."
    )


@lru_cache(maxsize=1)  # a report and the command that writes it both judge
def _error_in(calibration: Calibration, medium: str) -> float:
    """Return the root mean square error in px of the declared numbers with another medium
    outside.
    """
    declared, observations = calibration.declared, calibration.observations
    cover = declared.cover.replace_numbers({declared.cover.medium_name: Number(MEDIA[medium])})
    path, values = covered_path(declared.intrinsics, cover)
    poses = refine_poses(
        path, values, observations, pinhole_poses(path, values, observations)
    ).blocks
    return residuals(path, values, observations, poses).rms_px
