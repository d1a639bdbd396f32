"""The reasons from held-out views: those of the folds of a fit, and those of an evaluation."""

from dataclasses import replace

import pytest

from calib.calibration import Calibration
from calib.fit_record.history import DiagnosisRecord, History
from calib.fit_record.outcome import CrossValidation
from calib.fitting.evaluate import BadView, Evaluation
from calib.verdict.held_out import held_out, overfits
from calib.verdict.verdict import Trust
from fixtures.calibrated import with_outcome
from tests.verdict.cases import DIAGNOSE, SESSION, asked


@pytest.mark.parametrize(("held", "doubted"), [(0.124, False), (0.126, True)])
def test_overfitting(good: Calibration, held: float, doubted: bool) -> None:
    folds = CrossValidation(3, held, fitted_px=0.1)
    reasons = asked(overfits, with_outcome(good, cross_validation=folds))
    assert [reason.next for reason in reasons] == [
        f"calib fit '{SESSION}' --free none --grid auto"
    ] * doubted


def evaluated(rms: float, near: float, far: float) -> Evaluation:
    return Evaluation(rms, 0.0, 5, (), near, far, ())


def test_an_evaluation_is_judged_too(good: Calibration) -> None:
    last = good.stages[-1].rms_px
    assert not asked(held_out, good, evaluation=evaluated(1.49 * last, 0.4, 1.0))
    (worse,) = asked(held_out, good, evaluation=evaluated(1.51 * last, 0.4, 1.0))
    assert worse.next == f"{DIAGNOSE} --holdout 'other views'"
    (near,) = asked(held_out, good, evaluation=evaluated(last, 0.1, 1.0))
    assert "0.1 to 1 m away" in near.sentence


def test_pictures_of_something_else_must_not_be_used(good: Calibration) -> None:
    """An error of ten times the fitted one, and of half a pixel: not where it is smaller."""
    noisy = replace(good, stages=(*good.stages[:-1], replace(good.stages[-1], rms_px=0.06)))
    (reason,) = asked(held_out, noisy, evaluation=evaluated(0.61, 0.4, 1.0))
    assert reason.word is Trust.DO_NOT_USE
    assert "do not use it for such pictures" in reason.sentence
    assert reason.sentence.startswith("views that were not fitted have 0.610 px")
    assert reason.next == f"calib check '{SESSION}/calibration' 'other views'"
    (reason,) = asked(held_out, noisy, evaluation=evaluated(0.49, 0.4, 1.0))
    assert reason.word is Trust.CARE
    fitted = replace(evaluated(0.61, 0.4, 1.0), fitted_views=5)
    reused, reason = asked(held_out, noisy, evaluation=fitted)
    assert "fitted to all of these views" in reused.sentence
    assert reason.sentence.startswith("these views have 0.610 px")


def test_a_diagnosed_calibration_is_not_sent_back_to_the_diagnosis(good: Calibration) -> None:
    diagnosed = replace(good, history=History(diagnosis=DiagnosisRecord()))
    evaluation = evaluated(2 * good.stages[-1].rms_px, 0.4, 1.0)
    (reason,) = asked(held_out, diagnosed, evaluation=evaluation)
    assert reason.next.startswith("calib report")


def test_a_board_of_another_size_is_named(good: Calibration) -> None:
    error = good.stages[-1].rms_px
    same = replace(good.board, square=good.board.square * (1 + 1e-9))
    assert not asked(held_out, good, evaluation=replace(evaluated(error, 0.4, 1.0), board=same))
    smaller = replace(good.board, square=good.board.square / 10)
    (reason,) = asked(held_out, good, evaluation=replace(evaluated(error, 0.4, 1.0), board=smaller))
    sizes = [f"{1e3 * board.square:g} mm" for board in (smaller, good.board)]
    assert f"the squares are {sizes[0]} in other views, and {sizes[1]} in the" in reason.sentence
    another = replace(smaller, columns=good.board.columns + 1)
    assert not asked(held_out, good, evaluation=replace(evaluated(error, 0.4, 1.0), board=another))


def test_bad_views_are_named_beside_the_error_of_the_others(good: Calibration) -> None:
    last = good.stages[-1].rms_px
    bad = (BadView("07.png", 5.0), BadView("02.png", 3.0))
    evaluation = replace(
        evaluated(10 * last, 0.4, 1.0), bad_views=bad, other_views_rms_px=1.1 * last
    )
    (reason,) = asked(held_out, good, evaluation=evaluation)
    assert "07.png (5.000 px), 02.png (3.000 px) do not fit the calibration" in reason.sentence
    worse = replace(evaluation, other_views_rms_px=2 * last)
    assert len(asked(held_out, good, evaluation=worse)) == 2
