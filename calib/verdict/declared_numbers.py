"""Check: the declared numbers against the views."""

from collections.abc import Iterator, Sequence

import numpy as np

from calib.calibration import Calibration
from calib.estimation.prior_conflict import log_odds_of_swap
from calib.fitting.declared import BARE, DECLARED, VIEWS, Comparison, comparisons
from calib.session.parameter_names import CAMERA
from calib.verdict.bare_pictures import lens_advice
from calib.verdict.case import Case
from calib.verdict.medium import water_advice
from calib.verdict.residual import likely_effects
from calib.verdict.verdict import Reason

RIVAL_LOG_ODDS = 3.0
"""The log odds, 20 to 1, from which one of two declared numbers is named as the wrong one."""
SIDEWAYS = ("tilt.x", "tilt.y", "tilt.z", "offset.x", "centre.x", "centre.y")
"""The ends of the names of numbers that another index of the water does not imitate: it acts alike
on all sides.
"""
ADVICE = {
    DECLARED: "measure it again, and correct {description}",
    BARE: (
        "take the pictures in bare/ again, with the focus, the zoom and the picture size as they"
        " are under the cover"
    ),
}
"""Advice by the source of the number, with a gap for the place where the session is described."""


def declared_numbers(case: Case) -> Iterator[Reason]:
    """Report declared values that the data contradict, the largest deviation first.

    An estimate that is no more precise than the declaration contradicts nothing. A lens estimated
    from the same views is not evidence against them.
    """
    if not case.calibration.covariance.size:
        return
    model_lacks = bool(likely_effects(case))
    contradicted = [
        number
        for number in comparisons(case.calibration)
        if number.contradicted and number.corrected and number.source != VIEWS
    ]
    contradicted.sort(key=lambda number: -number.normalised_deviation)
    for number in contradicted:
        rivals = _rivals(case.calibration, number)
        advice = (
            "find what the model lacks first, which may cause it"
            if model_lacks
            else advice_on(case, (number.name, *rivals), number.source)
        )
        others = "".join(f", or {rival} is wrong" for rival in rivals)
        sentence = (
            f"{number}, {number.normalised_deviation:.1f} standard deviations apart{others}:"
            f" {advice}."
        )
        if not (CAMERA.has(number.name) or case.tried_all_shapes):
            sentence += (
                " If it is right, the cover may be of another shape: try"
                f" {case.next.unknown_cover}."
            )
        if number is contradicted[0] and not CAMERA.has(number.name):
            sentence += lens_advice(case)
            sentence += "" if number.name.endswith(SIDEWAYS) else water_advice(case)
        yield Reason(sentence, case.next.fit(), (number.name, *rivals))


def advice_on(case: Case, names: Sequence[str], source: str) -> str:
    """Return what to do about contradicted numbers of one source.

    A person can measure a cover again, but no focal length: a declared lens that is wrong was
    calibrated under other conditions.
    """
    calibration = case.calibration
    is_lens = all(CAMERA.has(name) for name in names)
    if source != DECLARED or calibration.outcome.intrinsics_from == "prior" or not is_lens:
        return ADVICE[source].format(description=case.next.description)
    through = ", or was made through the cover" if calibration.cover.shape != "none" else ""
    unknown = "write intrinsics: unknown in session.yaml"
    correction = (
        f"name a session of this lens at like (optional) in the set-up, or {unknown}"
        if case.next.in_form
        else f"leave --intrinsics out, and {unknown}"
    )
    return f"the file is of another focus or picture size{through}: {correction}"


def _rivals(calibration: Calibration, number: Comparison) -> list[str]:
    """Return the declared numbers whose error would explain the views about as well as that of a
    doubted number.
    """
    if not number.doubted:
        return []
    parameters = calibration.camera_model().parameters
    others = {
        row.name: row
        for row in comparisons(calibration)
        if not (row.held or row.unknown or row.doubted)
    }
    rivals = []
    for name in (param.name for param in parameters.free if param.name in others):
        pair = [number, others[name]]
        entries = parameters.entries([number.name, name])
        scales = parameters.scales.numpy()[entries - parameters.amplitudes]
        units = scales * [row.per_si for row in pair]
        odds = log_odds_of_swap(
            np.array([row.estimate - row.declared for row in pair]) / units,
            calibration.covariance[np.ix_(entries, entries)],
            np.array([row.tolerance for row in pair]) / units,
        )
        if odds > -RIVAL_LOG_ODDS:
            rivals.append(name)
    return rivals
