"""The diagnosis of a rig: what is hidden is found with its size, and nothing where there is
nothing.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from calib.cli import main
from calib.errors import NotEnoughDataError, WrongTypeError
from calib.rig.diagnose_rig import diagnose_rig
from calib.rig.explanation_fit import FittedExplanation
from calib.rig.explanations import RigExplanation
from calib.rig.fit_rig import fit_rig
from calib.rig.judge import judge_rig
from calib.rig.motion_evidence import FixedEstimate
from calib.rig.poses import move_points
from calib.rig.rig import Rig
from calib.rig.rig_content import FoundEffect
from calib.rig.rig_effects import BOARD_FLEX, RIG_EFFECTS, ROLLING_SHUTTER, SYNC_OFFSET
from calib.rig.rig_sentences import describe_found, describe_lateness, parameters_of
from fixtures.rig_motion import with_bursts, with_flex
from fixtures.rigs import SimulatedRig, join_pictures, simulate_rig, with_motion, with_pictures
from tests.rig.conftest import BOARD, EVEN, WINDOW

LATE_S = 8e-3
Make = Callable[[np.random.Generator, SimulatedRig], SimulatedRig]


def bare(seed: int, names: tuple[str, ...] = ("left", "right")) -> SimulatedRig:
    return simulate_rig(seed, WINDOW, placements=1, amplitude=0.0, board=BOARD, names=names)


def late(rng: np.random.Generator, rig: SimulatedRig) -> SimulatedRig:
    return with_bursts(rng, rig, 4, 5, late_s={"right": LATE_S})


def fitted_to(make: Make, folder: Path, seed: int = 21) -> tuple[Rig, SimulatedRig]:
    simulated = make(np.random.default_rng(seed), bare(seed))
    return fit_rig(simulated.write(folder / "rig"), EVEN), simulated


def baseline_error_mm(rig: Rig, simulated: SimulatedRig) -> float:
    true = float(simulated.cameras["right"].mounting[3:].norm())
    return 1e3 * abs(rig.baselines[0].metres - true)


@pytest.mark.slow
def test_a_late_camera_is_found_with_its_size(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig, simulated = fitted_to(late, tmp_path)
    rig.save(tmp_path / "calibration")
    verdict = judge_rig(rig, folder=tmp_path / "calibration")
    assert any("the diagnosis tells which" in reason.sentence for reason in verdict.reasons)
    assert main(["rig", "diagnose", str(tmp_path / "calibration"), "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert answer["accepted"] == ["sync_offset"]
    (effect,) = answer["effects"]
    assert (effect["camera"], effect["varies"]) == ("right", None)
    number = effect["parameters"]["sync_offset.late"]
    assert number["unit"] == "s"
    assert abs(number["value"] - LATE_S) < 4 * number["sigma"] < 1.2e-3
    assert "ms later than left" in effect["sentence"]
    assert not answer["families"]
    assert answer["bursts"] == 4
    assert answer["after"]["held_out_px"] < 0.3 * answer["before"]["held_out_px"]
    chosen = answer["candidates"][0]
    assert chosen["accepted"]
    assert chosen["held_out_px_after"] < chosen["held_out_px_before"]
    better = Rig.load(tmp_path / "calibration" / "diagnosed")
    assert better.record.effects[0].as_mapping() == effect
    assert baseline_error_mm(better, simulated) < 0.3 * baseline_error_mm(rig, simulated)
    assert (tmp_path / "calibration" / "diagnosed" / "report.html").is_file()


def test_nothing_is_found_in_a_rig_without_effects(fitted: Rig) -> None:
    better, diagnosis = diagnose_rig(fitted)
    assert diagnosis.accepted == ()
    assert better is fitted
    assert {candidate.effect for candidate in diagnosis.candidates} == {
        effect.name for effect in (*RIG_EFFECTS, BOARD_FLEX, ROLLING_SHUTTER)
    }
    assert all(candidate.verdict == "no more than chance" for candidate in diagnosis.candidates)
    # Single pictures of unknown motion cannot tell a constant lateness.
    (remark,) = diagnosis.remarks
    assert "cannot be told" in remark
    assert "time_s" in remark


def test_bad_input_gets_a_sentence(fitted: Rig) -> None:
    with pytest.raises(WrongTypeError):
        diagnose_rig(3)  # type: ignore[arg-type]
    shorter = {name: replace(c, views=c.views[:4]) for name, c in fitted.calibrations.items()}
    of_views = {name: places[:4] for name, places in fitted.of_views.items()}
    with pytest.raises(NotEnoughDataError, match="needs 10 or more"):
        diagnose_rig(replace(fitted, calibrations=shorter, of_views=of_views))


def lateness_of(value: float, sigma: float) -> FittedExplanation:
    """Return the fit of a lateness, s, in bursts of 15 pictures a second."""
    explanation = RigExplanation(SYNC_OFFSET, "right", is_late=True, interval_s=1 / 15)
    estimate = FixedEstimate(9.0, np.array([value]), np.array([[sigma**2]]))
    return FittedExplanation(explanation, 9.0, np.ones(2), np.ones(2), estimate, None, (), ())


@pytest.mark.parametrize(
    ("value", "sigma", "is_determined"),
    [(8e-3, 5e-5, True), (-0.028, 1e-3, True), (0.0309, 1.4e-3, False), (-0.0435, 1.3e-3, False)],
)
def test_the_size_of_a_long_delay_is_not_stated(
    fitted: Rig, value: float, sigma: float, is_determined: bool
) -> None:
    late = lateness_of(value, sigma)
    numbers = parameters_of(late)
    effect = FoundEffect("sync_offset", "right", "", "", numbers)
    effect = replace(effect, sentence=describe_found(effect, late, "left"))
    diagnosed = replace(fitted, record=replace(fitted.record, effects=(effect,)))
    advice = [r.sentence for r in judge_rig(diagnosed).reasons if "correct time_s" in r.sentence]
    assert numbers["sync_offset.late"].value == value
    assert ("ms later" in effect.sentence or "ms earlier" in effect.sentence) == is_determined
    assert ("cannot be told" in effect.sentence) != is_determined
    assert ("cannot be told" in describe_lateness(late)) != is_determined
    assert bool(advice) != is_determined
    stated = numbers["sync_offset.late"].sigma
    assert stated == (sigma if is_determined else pytest.approx(1 / 15))


@pytest.mark.slow
def test_a_delay_of_more_than_a_picture_has_no_size(tmp_path: Path) -> None:
    rig, _ = fitted_to(
        lambda rng, pair: with_bursts(rng, pair, 4, 5, late_s={"right": -0.08}), tmp_path
    )
    _, diagnosis = diagnose_rig(rig)
    (effect,) = diagnosis.found
    assert "right exposes earlier than left by about half of the 67 ms" in effect.sentence
    assert effect.parameters["sync_offset.late"].sigma == pytest.approx(1 / 15)


@pytest.mark.slow
def test_cameras_in_time_are_not_late(tmp_path: Path) -> None:
    rig, _ = fitted_to(lambda rng, pair: with_bursts(rng, pair, 4, 5), tmp_path)
    _, diagnosis = diagnose_rig(rig)
    assert diagnosis.accepted == ()
    assert any("ms later than" in remark for remark in diagnosis.remarks)
    number = next(
        c.parameters["sync_offset.late"]
        for c in diagnosis.candidates
        if "sync_offset.late" in c.parameters
    )
    assert abs(number.value) < 4 * number.sigma < 4e-4


@pytest.mark.slow
def test_a_mounting_that_flexes(tmp_path: Path) -> None:
    turn, shift = float(np.radians(0.02)), 1e-4

    def flex(rng: np.random.Generator, pair: SimulatedRig) -> SimulatedRig:
        return with_flex(rng, with_pictures(rng, pair, 20), "right", turn, shift)

    rig, simulated = fitted_to(flex, tmp_path)
    better, diagnosis = diagnose_rig(rig)
    assert diagnosis.accepted == ("rig_flex",)
    numbers = diagnosis.found[0].parameters
    for name, true in (("rig_flex.turn", turn), ("rig_flex.shift", shift)):
        assert abs(numbers[name].value - true) < 4 * numbers[name].sigma < 2 * true
    assert "degrees and" in diagnosis.found[0].sentence
    assert diagnosis.after.held_out_px < 0.4 * diagnosis.before.held_out_px
    sentences = [reason.sentence for reason in judge_rig(better).reasons]
    assert any("tighten the mounting" in sentence for sentence in sentences)
    error = baseline_error_mm(better, simulated)
    assert error < 4e3 * better.baselines[0].sigma


@pytest.mark.slow
def test_a_camera_that_slipped(tmp_path: Path) -> None:
    motion = np.array([0.0, 0.0, np.radians(0.03), 3e-4, 0.0, 0.0])

    def slip(rng: np.random.Generator, pair: SimulatedRig) -> SimulatedRig:
        later = with_motion(pair, "right", motion)
        pictures = with_pictures(rng, pair, 8), with_pictures(rng, later, 12)
        return replace(join_pictures(*pictures), cameras=later.cameras)

    rig, simulated = fitted_to(slip, tmp_path)
    better, diagnosis = diagnose_rig(rig)
    assert diagnosis.accepted == ("rig_slip",)
    (effect,) = diagnosis.found
    assert effect.from_file == "0008.png"
    assert "right slipped before 0008.png" in effect.sentence
    number = effect.parameters["rig_slip.shift.x"]
    assert abs(number.value + 3e-4) < 4 * number.sigma < 2e-4, "the camera goes the other way"
    # The rig's mounting is that after the slip.
    assert baseline_error_mm(better, simulated) < 4e3 * better.baselines[0].sigma


@pytest.mark.slow
def test_single_pictures_tell_that_the_board_moved_not_how_late(tmp_path: Path) -> None:
    def blind(rng: np.random.Generator, pair: SimulatedRig) -> SimulatedRig:
        moved = with_bursts(rng, pair, 20, 1, late_s={"right": LATE_S})
        views = {
            name: tuple(replace(view, time_s=None) for view in camera_views)
            for name, camera_views in moved.views.items()
        }
        return replace(moved, views=views)

    rig, _ = fitted_to(blind, tmp_path)
    _, diagnosis = diagnose_rig(rig)
    assert diagnosis.accepted == ("sync_offset",)
    assert diagnosis.found[0].varies == "each_view"
    assert "the board moves between the exposures" in diagnosis.found[0].sentence
    assert any("cannot be told" in remark for remark in diagnosis.remarks)


@pytest.mark.slow
def test_of_three_cameras_the_late_one_is_named(tmp_path: Path) -> None:
    trio = bare(23, ("left", "right", "third"))
    rng = np.random.default_rng(23)
    # The reference is late: all others see the board earlier on its path.
    simulated = with_bursts(rng, trio, 4, 5, late_s={"left": LATE_S})
    _, diagnosis = diagnose_rig(fit_rig(simulated.write(tmp_path / "rig"), EVEN))
    (effect,) = diagnosis.found
    assert (effect.effect, effect.camera) == ("sync_offset", "left")
    number = effect.parameters["sync_offset.late"]
    assert abs(number.value - LATE_S) < 4 * number.sigma < 1.2e-3
    assert "later than the others" in effect.sentence


@pytest.mark.slow
def test_two_late_cameras_of_three_are_late_against_the_third(tmp_path: Path) -> None:
    """The number of the first changes when the second is found, so both are those of one fit."""
    true = {"left": 0.0, "right": 8e-3, "third": -5e-3}
    trio = bare(24, tuple(true))
    rng = np.random.default_rng(24)
    simulated = with_bursts(rng, trio, 4, 5, late_s=true)
    _, diagnosis = diagnose_rig(fit_rig(simulated.write(tmp_path / "rig"), EVEN))
    assert diagnosis.accepted == ("sync_offset", "sync_offset")
    (in_time,) = set(true) - {effect.camera for effect in diagnosis.found}
    for effect in diagnosis.found:
        number = effect.parameters["sync_offset.late"]
        print(effect.sentence)
        assert number.value == pytest.approx(true[effect.camera] - true[in_time], abs=2.5e-4)
        assert f"than {in_time}" in effect.sentence
    assert not any("no more than chance" in remark for remark in diagnosis.remarks)


@pytest.mark.slow
def test_a_bent_board_is_no_effect_of_the_rig(tmp_path: Path) -> None:
    """A board that nobody declared as bent shifts corners in both cameras; no camera is blamed."""

    def bent(rng: np.random.Generator, pair: SimulatedRig) -> SimulatedRig:
        simulated = with_pictures(rng, pair, 16)
        flat = simulated.board.points()
        half = np.abs(flat).max(0)
        solid = np.column_stack([flat, 2e-3 * (1 - (flat[:, 0] / half[0]) ** 2)])
        views = {}
        for name, camera in simulated.cameras.items():
            pixels = [
                camera.see(move_points(pose, torch.from_numpy(solid)).numpy())
                for pose in simulated.placements
            ]
            views[name] = tuple(
                replace(view, corners=seen_px + rng.normal(0, 0.1, seen_px.shape))
                for view, seen_px in zip(simulated.views[name], pixels, strict=True)
            )
        return replace(simulated, views=views)

    rig, _ = fitted_to(bent, tmp_path)
    better, diagnosis = diagnose_rig(rig)
    assert diagnosis.accepted == ()
    assert better is rig
    chosen = next(c for c in diagnosis.candidates if c.verdict == "most probable")
    assert (chosen.effect, chosen.camera) == ("board_shape", "")
    assert "an effect of the board, not of the rig: board_shape" in diagnosis.remarks[0]


@pytest.mark.slow
def test_what_cannot_be_told_apart_is_a_family(tmp_path: Path) -> None:
    """A mounting that only shifts does what a board does that only shifts between exposures."""

    def shifting(rng: np.random.Generator, pair: SimulatedRig) -> SimulatedRig:
        return with_flex(rng, with_pictures(rng, pair, 16), "right", 0.0, 3e-4)

    rig, _ = fitted_to(shifting, tmp_path)
    _, diagnosis = diagnose_rig(rig)
    (family,) = diagnosis.families
    assert set(family.members) == {"rig_flex of right", "sync_offset of right"}
    assert sum(family.members.values()) == pytest.approx(1.0, abs=0.01)
    assert "To separate them" in str(family)
    assert diagnosis.accepted[0] in ("rig_flex", "sync_offset")
