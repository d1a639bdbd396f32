"""The check of a rig: unchanged cameras raise no alarm, and what moved is named with its size."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from calib import check_rig as public_check_rig
from calib.checking.result import Change, CheckStatus
from calib.checking.significance import ALPHA
from calib.cli import main
from calib.commands.rig_check_lines import next_rig_command
from calib.errors import InputError, NotEnoughDataError
from calib.progress import Silent
from calib.rig.check_result import CONTRADICTION, RigChange, RigCheckResult
from calib.rig.check_rig import RigChecker, check_rig
from calib.rig.fit_rig import fit_rig
from calib.rig.later_views import read_later_views, renumber_views
from calib.rig.placement_equations import LinearRig
from calib.rig.placements import Placements
from calib.rig.poses import compose
from calib.rig.rig import Rig
from calib.rig.rig_file import read_rig
from calib.rig.shared_placements import SharedPlacements
from calib.session.parameter_names import CAMERA
from fixtures.rigs import (
    SimulatedRig,
    join_pictures,
    simulate_rig,
    with_motion,
    with_pictures,
)
from tests.rig.conftest import BOARD, EVEN, WINDOW

Array = NDArray[np.float64]
Check = Callable[[SimulatedRig], RigCheckResult]

MILLIMETRE = np.array([0.0, 0.0, 0.0, 1e-3, 0.0, 0.0])
TENTH = np.array([0.0, np.radians(0.1), 0.0, 0.0, 0.0, 0.0])


def later(rig: SimulatedRig, seed: int, count: int) -> SimulatedRig:
    return with_pictures(np.random.default_rng(seed), rig, count)


def check_with(rig: Rig, folder: Path) -> Check:
    """Return a function that checks simulated pictures with one checker."""
    checker = RigChecker.of(rig)
    count = iter(range(10**6))

    def run(pictures: SimulatedRig) -> RigCheckResult:
        description = read_rig(pictures.write(folder / str(next(count))))
        views = {
            name: read_later_views(rig, description, name, Silent())[0]
            for name in description.sessions
        }
        places = Placements.of(description, {name: v.views for name, v in views.items()})
        return checker.check(renumber_views(rig, views, places), places)

    return run


@pytest.fixture(scope="module")
def check(fitted: Rig, tmp_path_factory: pytest.TempPathFactory) -> Check:
    return check_with(fitted, tmp_path_factory.mktemp("later"))


def only(result: RigCheckResult) -> RigChange:
    (change,) = result.changes
    return change


@pytest.mark.slow
def test_an_unchanged_rig_is_valid(pair: SimulatedRig, check: Check) -> None:
    for seed in range(3):
        result = check(later(pair, 50 + seed, 1 + seed))
        assert result.status is CheckStatus.VALID
        assert not result.changes
        place = result.places["right"]
        assert place.z < 3.5
        assert result.statistics
        assert result.statistics.error_px < result.statistics.allowed_px


@pytest.mark.slow
def test_a_camera_that_moved(pair: SimulatedRig, check: Check) -> None:
    result = check(later(with_motion(pair, "right", MILLIMETRE), 60, 3))
    assert result.status is CheckStatus.BROKEN
    change = only(result)
    assert (change.camera, change.change.name, change.from_file) == ("right", "moved", "")
    assert change.change.value
    assert change.change.sigma
    assert abs(change.change.value - 1.0) < 4 * change.change.sigma < 0.1
    assert "right is no longer where it was: it has moved against left by" in str(change.change)
    # The camera goes the other way than what it sees.
    numbers = {name: value for name, value, _, _ in change.change.parameters}
    assert numbers["shift.x"] == pytest.approx(-1e-3, abs=1e-4)
    place = result.places["right"]
    assert abs(place.moved[0] - 1e-3) < 4 * place.moved[1]
    assert place.z > 5


@pytest.mark.slow
def test_pictures_that_contradict_each_other_show_no_movement(
    pair: SimulatedRig, check: Check
) -> None:
    """Each picture of the right camera has the name of the one before."""
    pictures = later(pair, 66, 6)
    right = pictures.views["right"]
    shifted = tuple(
        replace(view, name=earlier.name) for view, earlier in zip(right[1:], right, strict=False)
    )
    result = check(replace(pictures, views={"left": pictures.views["left"], "right": shifted}))
    assert result.status is CheckStatus.UNDECIDED
    assert not result.places
    change = only(result)
    assert (change.camera, change.change.name) == ("right", CONTRADICTION)
    assert "pictures that right shares with left agree on where it is, so they show no" in (
        change.change.words
    )
    assert "Paired with the next picture of the other cameras, 4 of 4" in change.change.words
    assert result.unplaced["right"] == "its pictures contradict each other"
    assert next_rig_command(result, Path("rig"), Path("later")) == "calib rig check rig later"


def test_a_camera_that_turned(pair: SimulatedRig, check: Check) -> None:
    result = check(later(with_motion(pair, "right", TENTH), 61, 4))
    change = only(result)
    assert (change.camera, change.change.name, change.change.unit) == (
        "right",
        "turned",
        "degrees",
    )
    assert change.change.value
    assert change.change.sigma
    assert abs(change.change.value - 0.1) < 4 * change.change.sigma < 0.02


@pytest.mark.slow
def test_a_crash_is_measured_beyond_the_first_order(pair: SimulatedRig, check: Check) -> None:
    motion = np.array([0.03, 0.02, 0.0, 0.01, 0.005, 0.0])
    result = check(later(with_motion(pair, "right", motion), 5, 4))
    change = only(result).change
    assert change.name == "moved_and_turned"
    assert change.value
    assert change.sigma
    assert abs(change.value - 1e3 * np.linalg.norm(motion[3:])) < 4 * change.sigma < 0.2
    assert "turned by 2.06" in str(change) or "turned by 2.07" in str(change)


@pytest.mark.slow
def test_a_camera_that_slipped_at_one_moment(pair: SimulatedRig, check: Check) -> None:
    slipped = join_pictures(
        later(pair, 62, 3), later(with_motion(pair, "right", MILLIMETRE), 63, 3)
    )
    change = only(check(slipped))
    assert (change.camera, change.from_file) == ("right", "0003.png")
    assert "right slipped between 0002.png and 0003.png" in str(change.change)
    assert change.change.value
    assert change.change.sigma
    assert abs(change.change.value - 1.0) < 4 * change.change.sigma < 0.1


@pytest.mark.slow
def test_a_board_that_moved_between_two_pictures(pair: SimulatedRig, check: Check) -> None:
    """Negative control of a slip: one placement alone is left out by name."""
    moving = join_pictures(
        later(pair, 64, 2), later(with_motion(pair, "right", MILLIMETRE), 65, 1), later(pair, 66, 2)
    )
    result = check(moving)
    assert result.status is CheckStatus.VALID
    assert {view.file for view in result.rejected} == {"0002.png"}


def test_a_camera_whose_own_calibration_changed(pair: SimulatedRig, check: Check) -> None:
    """A focus that moved is of the camera: its place is not judged by it."""
    camera = pair.cameras["right"]
    values = dict(camera.values)
    for name in (CAMERA.fx, CAMERA.fy):
        values[name] = 1.02 * values[name]
    changed = replace(pair, cameras={**pair.cameras, "right": replace(camera, values=values)})
    result = check(later(changed, 67, 4))
    assert result.status is not CheckStatus.VALID
    assert {change.camera for change in result.changes} <= {"right", ""}
    names = {change.change.name for change in result.changes}
    assert "focal" in names
    assert not names & {"moved", "turned", "moved_and_turned"}


def test_motions_agree_with_central_differences(
    pair: SimulatedRig, fitted: Rig, tmp_path: Path
) -> None:
    """Oracle: the residuals of the same corners with the camera at another mounting."""
    linear = LinearRig.of(fitted, with_changes=False)
    description = read_rig(later(pair, 68, 1).write(tmp_path))
    views = {
        name: read_later_views(fitted, description, name, Silent())[0] for name in fitted.names
    }
    placements = Placements.of(description, {name: v.views for name, v in views.items()})
    shared = SharedPlacements.of(
        linear,
        {name: v.views for name, v in views.items()},
        {name: v.poses for name, v in views.items()},
        placements,
        dict.fromkeys(views, BOARD),
        {},
    )
    assert shared
    for name in fitted.names:
        place = linear.columns()[name]
        information = shared.predictive().products.sum(0)[place, place]
        for index in range(6):
            step = np.zeros(6)
            step[index] = 1e-5
            scores = []
            for sign in (1, -1):
                groups = tuple(
                    (
                        camera,
                        replace(
                            views,
                            mounting=compose(torch.from_numpy(sign * step), views.mounting),
                        )
                        if camera.name == name
                        else views,
                    )
                    for camera, views in shared.groups
                )
                products = replace(shared, groups=groups).predictive().products.sum(0)
                scores.append(products[place, 0])
            difference = (scores[0] - scores[1]) / 2e-5
            scale = np.sqrt(information.diagonal() * information[index, index])
            assert np.abs((difference - information[:, index]) / scale).max() < 0.02


@pytest.mark.slow
def test_the_reference_of_three_cameras(tmp_path: Path) -> None:
    """With a third camera, the placements tell which one moved, the reference included."""
    names = ("left", "right", "third")
    rig = simulate_rig(3, WINDOW, placements=10, amplitude=0.0, board=BOARD, names=names)
    made = fit_rig(rig.write(tmp_path / "rig"), EVEN)
    moved = later(with_motion(rig, "left", MILLIMETRE), 70, 3)
    result = check_rig(made, moved.write(tmp_path / "moved"))
    change = only(result)
    assert (change.camera, change.change.name) == ("left", "moved")
    assert change.change.value
    assert change.change.sigma
    assert abs(change.change.value - 1.0) < 4 * change.change.sigma < 0.1


@pytest.mark.slow
def test_the_command_has_the_exit_codes_of_calib_check(
    pair: SimulatedRig, fitted: Rig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fitted.save(tmp_path / "rig")
    rig = str(tmp_path / "rig")
    later(pair, 71, 3).write(tmp_path / "good")
    later(with_motion(pair, "right", MILLIMETRE), 72, 3).write(tmp_path / "bad")
    assert main(["rig", "check", rig, str(tmp_path / "good"), "--json"]) == 0
    good = json.loads(capsys.readouterr().out)
    assert good["answer"] == "valid"
    assert good["false_alarm_rate"] == ALPHA
    assert set(good["cameras"]) == {"left", "right"}
    assert good["cameras"]["right"]["place"]["moved_mm"]["sigma"] > 0
    pair.write(tmp_path / "fitted")
    assert main(["rig", "check", rig, str(tmp_path / "fitted")]) == 0
    assert capsys.readouterr().out.startswith("Not checked: the rig was made from these pictures")
    assert main(["rig", "check", rig, str(tmp_path / "bad")]) == 5
    text = capsys.readouterr().out
    assert "The rig is broken for these pictures." in text
    assert "it has moved against left by" in text
    assert "two cameras do not show which of them moved: right, or left instead." in text
    assert f"Next: capture {tmp_path}/bad-again --source NAME=SOURCE ..." in text


def test_contradicting_pictures_are_not_enough_to_judge_a_rig(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    change = RigChange("right", Change(CONTRADICTION, "the pictures show no movement", 1.0))
    undecided = RigCheckResult(
        status=CheckStatus.UNDECIDED,
        p_value=0.0,
        statistics=None,
        changes=(change,),
        cameras={},
        places={},
        base="left",
        unplaced={},
        placements=4,
        rejected=(),
    )
    monkeypatch.setattr("calib.rig.check_rig.check_rig", lambda *_: undecided)
    assert main(["rig", "check", "rig", "today", "--json"]) == NotEnoughDataError.exit_code
    assert json.loads(capsys.readouterr().out)["answer"] == "undecided"
    assert main(["rig", "check", "rig", "today"]) == NotEnoughDataError.exit_code
    printed = capsys.readouterr().out
    assert printed.startswith("These pictures do not show whether the rig is valid.")


def test_the_description_of_a_rig_is_no_calibration(pair: SimulatedRig, tmp_path: Path) -> None:
    file = pair.write(tmp_path)
    with pytest.raises(InputError, match=r"describes a rig and is no calibration: `calib rig fit "):
        Rig.load(file)


def test_what_cannot_be_checked_gets_a_sentence(
    pair: SimulatedRig, fitted: Rig, tmp_path: Path
) -> None:
    parted = later(pair, 73, 2)
    views = {"left": parted.views["left"][:1], "right": parted.views["right"][1:]}
    file = replace(parted, views=views).write(tmp_path)
    with pytest.raises(NotEnoughDataError, match="at the same moment"):
        public_check_rig(fitted, file)
    with pytest.raises(InputError, match="no covariance"):
        check_rig(replace(fitted, covariance=np.zeros((0, 0))), file)


@pytest.mark.slow
def test_false_alarms_are_as_rare_as_stated(pair: SimulatedRig, check: Check) -> None:
    """At the stated rate of 1 %, 6 and more of 200 checks are an alarm with probability 1.6 %."""
    results = [check(later(pair, 1000 + seed, 1 + seed % 4)) for seed in range(200)]
    assert sum(result.p_value < ALPHA for result in results) < 6
