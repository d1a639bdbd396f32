"""Checks: the errors on held-out views of the fit's folds, and of an evaluation."""

from collections.abc import Iterator

from calib.fitting.corner_range import trusted_depths
from calib.fitting.evaluate import Evaluation
from calib.verdict.case import Case
from calib.verdict.thresholds import HELD_OUT
from calib.verdict.verdict import Reason

MOST_BAD_VIEWS = 10
"""Views that a sentence names."""


def overfits(case: Case) -> Iterator[Reason]:
    validation = case.calibration.outcome.cross_validation
    if validation and validation.overfits:
        sentence = (
            "the fit overfits, views that it has not seen are much further off"
            f" ({validation.held_out_px:.3f} px for {validation.fitted_px:.3f} px): take more"
            " views, or choose a coarser grid."
        )
        yield Reason(sentence, case.next.fit("--grid", "auto"))


def held_out(case: Case) -> Iterator[Reason]:
    evaluation = case.evaluation
    if not evaluation:
        return
    near, far = case.reach
    if 2 * (count := evaluation.fitted_views) > evaluation.frames_used:
        which = "all of" if count == evaluation.frames_used else f"{count} of"
        sentence = (
            f"the calibration was fitted to {which} these views, so their error is no test: take"
            " new pictures, or leave some out of the fit."
        )
        yield Reason(sentence, case.next.evaluate())
    nearest, farthest = trusted_depths(near, far)
    extrapolated = evaluation.near_m < nearest or evaluation.far_m > farthest
    error = evaluation.rms_px
    if evaluation.bad_views and evaluation.other_views_rms_px is not None:
        error = evaluation.other_views_rms_px
        yield Reason(_describe_bad_views(evaluation, error), case.next.evaluate())
    if error > HELD_OUT * case.left_px:
        note = (
            ", some of them at depths of which the calibration's do not speak"
            if extrapolated
            else ""
        )
        sentence = (
            f"views that were not fitted have {error:.3f} px where the fitted ones have"
            f" {case.left_px:.3f} px{note}: the model lacks something, or these views are of"
            " another setup."
        )
        yield Reason(sentence, case.next.diagnose("--holdout", case.holdout))
    elif extrapolated:
        sentence = (
            f"the evaluated views are {evaluation.near_m:.2g} to {evaluation.far_m:.2g} m"
            f" away, and the fitted ones {near:.2g} to {far:.2g} m:"
            " the calibration was not made for all of these depths."
        )
        yield Reason(sentence, case.next.capture())


def _describe_bad_views(evaluation: Evaluation, error: float) -> str:
    """Return a sentence on the views that do not fit; `error` is that of the others, px."""
    views = evaluation.bad_views
    names = ", ".join(f"{view.file} ({view.rms_px:.3f} px)" for view in views[:MOST_BAD_VIEWS])
    surplus = f" and {len(views) - MOST_BAD_VIEWS} more" if len(views) > MOST_BAD_VIEWS else ""
    verb = "does" if len(views) == 1 else "do"
    return (
        f"{names}{surplus} {verb} not fit the calibration, the other views have {error:.3f} px:"
        " the board or the camera may have moved there, or the board was bent. Leave them out, or"
        " take them again."
    )
