"""The loop: it names what is hidden, finds nothing where nothing is, and stands bad views."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from calib.apply.map_uncertainty import predicted_sigma
from calib.calibration import Calibration
from calib.cli import main
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.finding import Diagnosis
from calib.diagnosis.requested_effects import with_requested
from calib.diagnosis.sentences import trial_verdict
from calib.diagnosis.trial import Trial
from calib.effects.board_shape import BoardShape
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.parameters import Parameters
from calib.estimation.priors import NONE
from calib.fit_record.request import FitRequest, Settings
from calib.inference.cross_validation import HeldOutErrors, HeldOutGain, held_out_gain
from calib.inference.fitted_model import ModelFit
from calib.inference.score_test import ScoreTest
from calib.optics import path
from calib.optics.lens_model import LensModel
from calib.progress import Silent
from tests.diagnosis.hide import fitted, hidden

BOW = BoardShape(0.08, 0.08)
TRUTH = {"board_shape.xx": 6e-4, "board_shape.xy": 3e-4, "board_shape.yy": -4e-4}


@pytest.fixture(scope="module")
def bowed() -> Calibration:
    return fitted(hidden(BOW, TRUTH))


@pytest.fixture(scope="module")
def diagnosed(bowed: Calibration) -> tuple[Calibration, Diagnosis]:
    return diagnose(bowed, Silent())


def test_a_bowed_board_is_named_with_its_parameters(
    diagnosed: tuple[Calibration, Diagnosis],
) -> None:
    _, finding = diagnosed
    assert finding.accepted == ("board_shape",)
    candidates = [candidate for candidate in finding.candidates if candidate.accepted]
    (accepted,) = candidates
    for name, value in TRUTH.items():
        item = accepted.parameters[name]
        assert abs(item.value - value) < 3 * item.sigma
        assert item.sigma < 3e-5
    assert accepted.gain_ci95
    assert accepted.gain_ci95[0] > 0
    assert accepted.depth_bands_px
    assert (
        accepted.depth_bands_px[1] < 0.5 * accepted.depth_bands_px[0]
    )  # it helps near with what is learnt far away, and the other way round
    assert finding.final_quality.held_out_px < 0.2 < finding.base_quality.held_out_px
    assert finding.residual[0].fraction > 2 * finding.residual[0].chance
    assert finding.unexplained is not None
    assert finding.unexplained < 0.2


@pytest.mark.usefixtures("without_figures")
@pytest.mark.slow
def test_the_command_s_json_carries_the_verdict(
    diagnosed: tuple[Calibration, Diagnosis], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    better, finding = diagnosed
    better = replace(better, request=FitRequest(Settings(grid=None, free=())))
    assert main(["diagnose", str(better.save(tmp_path)), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    described = {"camera", "cover", "board", "calibration"}
    assert set(answer) == {*finding.as_json(), *described, "verdict", "written"}
    assert answer["written"] == [
        str(tmp_path / "diagnosed" / name) for name in ("calibration.yaml", "report.html")
    ]
    assert list(answer["verdict"]) == ["word", "maps_hold", "reasons", "suspects", "next", "notes"]


def test_the_contract_s_json_has_its_keys(diagnosed: tuple[Calibration, Diagnosis]) -> None:
    report = diagnosed[1].as_json()
    assert {"residual", "candidates", "accepted", "before", "after", "unexplained"} <= set(report)
    assert set(report["before"]) == {"rms_px", "rmse_cm", "held_out_px"}
    keys = {
        "effect",
        "chi2",
        "dof",
        "p_value",
        "held_out_px_before",
        "held_out_px_after",
        "gain_ci95",
        "parameters",
        "confounded_with",
    }
    assert all(keys <= set(candidate) for candidate in report["candidates"])
    assert set(report["unexplained"]) == {"fraction", "organised_by"}


@pytest.mark.slow
def test_the_diagnosed_calibration_is_kept_and_can_be_diagnosed_again(
    diagnosed: tuple[Calibration, Diagnosis], tmp_path: Path
) -> None:
    better, finding = diagnosed
    better.save(tmp_path)
    read_back = Calibration.load(tmp_path)
    pixels = np.array([[1600.0, 1200.0], [400.0, 300.0]])
    assert np.array_equal(read_back.rays(pixels)[1], better.rays(pixels)[1])
    _, second = diagnose(read_back, Silent())
    assert second.accepted == ("board_shape",)  # it is in the model already, and nothing is added
    assert second.added == ()
    assert second.headline.startswith("Nothing found beside board_shape: no known effect")
    assert second.final_quality.rms_px == pytest.approx(finding.final_quality.rms_px, rel=0.01)


@pytest.mark.parametrize("spoiled", [pytest.param(0, marks=pytest.mark.slow), 2])
def test_no_effect_is_found_in_true_models(spoiled: int) -> None:
    """The views are alike, or two of fifteen are four times as noisy."""
    _, finding = diagnose(fitted(hidden(None, {}, seed=7, spoiled=spoiled)), Silent())
    assert finding.accepted == ()
    assert finding.final_quality == finding.base_quality


def test_an_effect_can_be_requested_by_name(bowed: Calibration) -> None:
    better = with_requested(bowed, ("board_shape",), Silent())
    (added,) = better.effects
    value, sigma = added.parameters["board_shape.xx"]
    assert abs(float(value) - TRUTH["board_shape.xx"]) < 3 * float(sigma)
    assert better.stages[-1].name == "cover+rbf+effects"
    assert better.stages[-1].rms_px < 0.5 * better.stages[-2].rms_px
    with pytest.raises(InputError, match="flat_port"):
        with_requested(bowed, ("flat_port",), Silent())


@pytest.mark.slow
def test_an_added_effect_that_is_not_needed_is_dropped(bowed: Calibration) -> None:
    """A pull of the detector that nobody sees, and the bow that everybody does."""
    requested = with_requested(bowed, ("detector_bias", "board_shape"), Silent())
    better, finding = diagnose(requested, Silent())
    assert finding.accepted == ("board_shape",)
    assert [type(bend) for bend in better.model()[0].target.bends] == [BoardShape]
    assert not better.model()[0].adjustments


def test_too_few_views_are_refused_in_a_sentence() -> None:
    with pytest.raises(NotEnoughDataError, match="needs 5 or more"):
        diagnose(fitted(hidden(None, {}, views=4)), Silent())


@pytest.mark.parametrize(
    ("effect", "parameters", "remark"),
    [
        (BOW, TRUTH, "board_shape (error down by up to "),
        pytest.param(None, {}, "No effect's", marks=pytest.mark.slow),
    ],
)
def test_few_views_give_scores_and_no_accepted_effect(
    effect: BoardShape | None, parameters: dict[str, float], remark: str
) -> None:
    calibration = fitted(hidden(effect, parameters, views=7))
    better, finding = diagnose(calibration, Silent())
    assert finding.accepted == ()
    assert not better.model()[0].target.bends
    assert finding.remarks[0].startswith(
        "With 7 views nothing can be confirmed on held-out views: take 10 or more. "
    )
    assert remark in finding.remarks[0]


def held(residual: np.ndarray, *, half: bool = False) -> HeldOutErrors:
    """(V, M, 2) px that are left of held-out views."""
    view = np.repeat(np.arange(len(residual)), residual.shape[1])
    return HeldOutErrors(residual.reshape(-1, 2), view, np.ones(len(view)), half)


def test_a_gain_is_tested_over_views() -> None:
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(20, 80, 2))
    errors_before = held(noise)
    same = held_out_gain(errors_before, held(rng.normal(size=(20, 80, 2))))
    assert same.p_value > 0.05
    assert same.ci95[0] < 0 < same.ci95[1]
    better = held_out_gain(errors_before, held(0.8**0.5 * noise))
    assert better.p_value < 1e-3
    assert better.relative == pytest.approx(1 - 0.8**0.5, abs=0.01)
    one_view = noise.copy()
    one_view[3] *= 0.1**0.5
    assert (
        held_out_gain(errors_before, held(one_view)).p_value > 0.05
    )  # a single view proves nothing


def test_the_presence_of_an_effect_is_detected_before_its_gain() -> None:
    """Twelve views of an effect of 0.3 sigma; what others say of it is off by as much as it is
    large, so half of the views lose by it.
    """
    rng = np.random.default_rng(2)
    true = rng.normal(0, 0.3, (80, 2))
    predicted = true + rng.normal(0, 0.3, (12, 80, 2))
    views = true + rng.normal(0, 1, (12, 80, 2))
    gain = held_out_gain(held(views), held(views - predicted))
    assert gain.p_value > 0.05
    assert gain.presence_p_value < 1e-3
    assert held_out_gain(held(views), held(views - predicted, half=True)).presence_p_value == 1


@pytest.mark.slow
def test_an_absent_effect_is_detected_at_the_rate_of_chance() -> None:
    """The prediction for the views of a fold is independent of them. 9 % of 300 are three standard
    deviations from 5 %.
    """
    rng = np.random.default_rng(4)
    by_chance = 0
    for _ in range(300):
        predicted = np.repeat(
            rng.normal(0, 0.3, (4, 80, 2)), 3, axis=0
        )  # of the views of a fold, the same
        views = rng.normal(0, 1, (12, 80, 2))
        by_chance += held_out_gain(held(views), held(views - predicted)).presence_p_value < 0.05
    assert by_chance <= 27


def test_an_effect_that_helps_only_at_fitted_depths_is_not_accepted() -> None:
    test = ScoreTest(BOW, np.ones((4, 2)), 8.0, 50.0, 2, lambda: 1e-6, 100.0, np.eye(2), np.ones(2))
    folds, worse, better = (
        HeldOutGain(0.2, 0.1, (0.08, 0.12), 1e-4, 1e-4),
        HeldOutGain(0.2, 0.21, (-0.02, 0.0), 1.0, 1.0),
        HeldOutGain(0.2, 0.15, (-0.01, 0.1), 0.2, 0.2),
    )
    assert Trial(test, gain=folds).passes
    assert Trial(test, gain=folds, depth_gain=better).passes
    failed = Trial(test, gain=folds, depth_gain=worse)
    assert not failed.passes
    assert trial_verdict(failed, accepted=False) == "fails at other depths"


def test_strong_evidence_lowers_the_required_gain() -> None:
    """exp(6) is about 20 candidates over 0.05."""
    test = ScoreTest(BOW, np.ones((4, 2)), 8.0, 50.0, 2, lambda: 1e-6, 100.0, np.eye(2), np.ones(2))
    uncertain_gain = HeldOutGain(0.2, 0.18, (-0.01, 0.04), 0.3, 0.02)
    assert not Trial(test, among=20, gain=uncertain_gain).passes
    assert not Trial(test, among=20, log_odds=5.9, gain=uncertain_gain).passes
    assert Trial(test, among=20, log_odds=6.1, gain=uncertain_gain).passes
    assert not Trial(
        test, among=20, log_odds=6.1, gain=replace(uncertain_gain, presence_p_value=0.06)
    ).passes
    by_halves = HeldOutGain(0.2, 0.18, (0.001, 0.04), 0.02, 1.0)
    assert Trial(test, among=20, log_odds=6.1, gain=by_halves).passes, (
        "where halves of views are scored, its gain alone is asked for"
    )
    assert not Trial(test, among=20, log_odds=5.9, gain=by_halves).passes
    assert not Trial(
        test, among=20, log_odds=6.1, gain=replace(uncertain_gain, extended_px=0.1999)
    ).passes, "it is there, and takes nothing"
    by_chance, harm = (
        HeldOutGain(0.2, 0.21, (-0.03, 0.01), 0.6, 0.6),
        HeldOutGain(0.2, 0.21, (-0.03, -0.01), 1.0, 1.0),
    )
    assert Trial(test, among=20, log_odds=6.1, gain=uncertain_gain, depth_gain=by_chance).passes
    assert not Trial(test, among=20, log_odds=6.1, gain=uncertain_gain, depth_gain=harm).passes


def test_an_error_within_the_corners_accuracy_is_no_effect() -> None:
    """1 % of 0.013 px is the root of two times that squared, 0.0019 px; the same share of 0.13 px
    is an effect.
    """
    test = ScoreTest(BOW, np.ones((4, 2)), 8.0, 50.0, 2, lambda: 1e-6, 100.0, np.eye(2), np.ones(2))
    assert not Trial(test, gain=HeldOutGain(0.0133, 0.01315, (1e-4, 2e-4), 1e-4, 1e-4)).passes
    assert Trial(test, gain=HeldOutGain(0.133, 0.1315, (1e-3, 2e-3), 1e-4, 1e-4)).passes
    assert HeldOutGain(0.1, 0.2, (-0.1, -0.1), 1.0, 1.0).explained_px == 0


def test_a_candidate_whose_fit_is_not_finite_is_not_taken() -> None:
    test = ScoreTest(BOW, np.ones((4, 2)), 8.0, 50.0, 2, lambda: 1e-6, 100.0, np.eye(2), np.ones(2))
    nothing = torch.zeros(0, 0, dtype=torch.float64)
    joint = JointFit(
        values={},
        poses=nothing,
        covariance=nothing,
        sigma=0.1,
        smoothness=None,
        parameters=Parameters.none({}),
        cost=0.0,
        outcome=Outcome.NOT_FINITE,
        iterations=1,
        log_evidence=-np.inf,
        log_marginal=-np.inf,
    )
    trial = Trial(test, ModelFit(CameraModel(path.Path(LensModel(0)), {}, NONE), joint))
    assert not trial.passes
    assert trial_verdict(trial, accepted=False) == "not finite"


def test_maps_of_a_diagnosed_calibration_carry_their_sigma(
    diagnosed: tuple[Calibration, Diagnosis],
) -> None:
    """A bend of the board moves no ray, but makes the fit less certain of the glass: sigma grows a
    little.
    """
    better, _ = diagnosed
    field = predicted_sigma(better)
    assert field
    at = np.full((1, 1), 1600.0), np.full((1, 1), 1200.0)
    assert 0.001 < float(field.at(*at, 0.8)[0, 0]) < 1.0
