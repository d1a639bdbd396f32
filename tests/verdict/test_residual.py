"""The sentence on an error beyond the noise: what may cause it, and how much that would explain."""

from dataclasses import replace

import pytest

from calib.calibration import Calibration
from calib.calibration_content import Stage
from calib.effects.board_scale import BoardScale
from calib.effects.lens import LensEffect
from calib.verdict import residual as module
from calib.verdict.residual import COVER_QUESTION, asks_for_cover, residual
from calib.verdict.verdict import Reason, Verdict
from tests.diagnosis.hide import without_cover
from tests.verdict.cases import asked


def test_each_suspected_effect_says_how_much_it_explains(
    good: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    noisy = replace(good, noise_px=0.1 * good.stages[-1].rms_px)
    lens, scale = LensEffect(), BoardScale()
    monkeypatch.setattr(module, "_explains", lambda *_: True)
    monkeypatch.setattr(module, "likely_effects", lambda _: [(lens, 0.58), (scale, 0.3)])
    (reason,) = asked(residual, noisy)
    assert (
        ": it may be lens (the distortion of the lens differs from the fitted one), or board_scale"
        " (the print is longer in one direction than in the other). A fit with lens would have"
        " 58 % less error, with board_scale 30 %."
    ) in reason.sentence
    monkeypatch.setattr(module, "likely_effects", lambda _: [(scale, 0.3)])
    (reason,) = asked(residual, noisy)
    assert "). A fit with board_scale would have 30 % less error." in reason.sentence


def test_a_cover_is_asked_for_unless_all_shapes_were_tried() -> None:
    bare = without_cover(BoardScale(), {"board_scale.x_over_y": 0.01}, 0.01)
    bare = replace(bare, noise_px=0.01, stages=(Stage("pinhole", 0.5, 0.1),))
    (reason,) = asked(residual, bare)
    assert COVER_QUESTION in reason.sentence
    odds = {"none": 0.0, "dome": -3.0}
    (reason,) = asked(residual, replace(bare, outcome=replace(bare.outcome, shape_log_odds=odds)))
    assert COVER_QUESTION not in reason.sentence


def test_a_lens_that_may_look_through_a_cover_is_asked_about(good: Calibration) -> None:
    """The cover may cause what such a fit says of the board."""
    worse = replace(good, stages=(*good.stages[:-1], replace(good.stages[-1], rms_px=0.5)))
    question = Reason(f"the error is 0.5 px. {COVER_QUESTION}", "calib diagnose it")
    assert asks_for_cover(Verdict((question,), "calib report"))
    assert not asks_for_cover(Verdict(tuple(asked(residual, worse)), "calib report"))
