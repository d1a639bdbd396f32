"""Checks: the errors on held-out views of the fit's folds, and of an evaluation."""

from collections.abc import Iterator

from calib.fitting.board_difference import describe_difference, has_same_corners
from calib.fitting.evaluate import Evaluation
from calib.fitting.supported_depths import trusted_depths
from calib.verdict.case import Case
from calib.verdict.thresholds import HELD_OUT, HELD_OUT_ELSEWHERE, MIN_ELSEWHERE
from calib.verdict.verdict import Reason, Trust

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
    yield from _other_squares(case, evaluation)
    if error > HELD_OUT * case.left_px:
        note = (
            ", some of them nearer or farther than the calibration's boards" if extrapolated else ""
        )
        is_elsewhere = error > max(HELD_OUT_ELSEWHERE * case.left_px, MIN_ELSEWHERE)
        advice = (
            "do not use it for such pictures. They are of another camera, cover or board, or"
            " something has moved."
            if is_elsewhere
            else "the model lacks something, or these views are of another setup."
        )
        is_diagnosed = case.calibration.history.diagnosis is not None
        diagnose = case.next.diagnose("--holdout", case.holdout)
        next_command = case.next.report() if is_diagnosed else diagnose
        if is_elsewhere:  # a diagnosis of the calibration's own views says nothing of these
            next_command = case.next.check(case.holdout)
        which = "these views" if count else "views that were not fitted"
        yield Reason(
            f"{which} have {error:.3f} px where the calibration's own have {case.left_px:.3f}"
            f" px{note}: {advice}",
            next_command,
            word=Trust.DO_NOT_USE if is_elsewhere else Trust.CARE,
        )
    elif extrapolated:
        sentence = (
            f"the evaluated views are {evaluation.near_m:.2g} to {evaluation.far_m:.2g} m"
            f" away, and the fitted ones {near:.2g} to {far:.2g} m:"
            " the calibration was not made for all of these depths."
        )
        yield Reason(sentence, case.next.capture())


def _other_squares(case: Case, evaluation: Evaluation) -> Iterator[Reason]:
    """Report a board that has the corners of the calibration's and another size."""
    board, fitted = evaluation.board, case.calibration.board
    if not (board and has_same_corners(board, fitted)):
        return
    if difference := describe_difference(board, fitted, f"in {case.holdout}"):
        sentence = f"{difference}: if it is the same board, correct the one that is wrong."
        yield Reason(sentence, case.next.evaluate())


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
