"""Effects that are requested by name for a rig: those of the board are one for all cameras, those
of a camera are its own.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from calib.cli import main
from calib.effects.entrance_pupil import EntrancePupil
from calib.errors import InputError
from calib.fit_record.request import Settings
from calib.rig.fit_rig import fit_rig
from calib.rig.requested_effects import requested_by_camera
from calib.rig.rig import Rig
from calib.rig.rig_file import read_rig
from calib.rig.rig_result import state_of
from calib.session.cover import Cover
from fixtures.rig_bends import with_bends, with_bent_board
from fixtures.rigs import SimulatedRig, simulate_rig, with_pictures
from tests.rig.conftest import EVEN, WINDOW
from tests.rig.test_board_flex import BEND, SHEET, rms

BOW = 8e-4
"""m"""
PUPIL = "entrance_pupil.e2"
NEAR = 0.3, 0.6
"""m: so near, the place of the pupil matters."""


@pytest.fixture(scope="module")
def bowed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a pair that saw a bowed board."""
    rng = np.random.default_rng(7)
    bend = np.zeros(12)
    bend[0] = BOW
    rig = with_bent_board(rng, simulate_rig(7, WINDOW, placements=12, amplitude=0.0), bend)
    return rig.write(tmp_path_factory.mktemp("bowed") / "rig").parent


def test_the_shape_of_the_board_is_one_for_all_cameras(bowed: Path) -> None:
    flat = fit_rig(bowed, EVEN)
    rig = fit_rig(bowed, EVEN, effects=("board_shape",))
    assert all(c.stages[-1].rms_px > 0.16 for c in flat.calibrations.values())
    assert all(c.stages[-1].rms_px < 0.15 for c in rig.calibrations.values())
    shapes = []
    for calibration in rig.calibrations.values():
        (added,) = calibration.effects
        shapes.append({name: float(value) for name, (value, _) in added.parameters.items()})
    assert shapes[0] == shapes[1]
    assert len(rig.covariance) == len(flat.covariance) + len(shapes[0])
    value, sigma = added.parameters["board_shape.xx"]
    assert abs(value - BOW) < 3 * sigma < 1e-4


def test_the_command_adds_effects(
    bowed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """By default, the fit finds the bow; `none` leaves it out."""
    words = ["rig", "fit", str(bowed), "--grid", "1x1", "--json", "-q"]
    effects = {}
    for names in ((), ("--effects", "none"), ("--effects", "board_shape,detector_bias")):
        out = tmp_path / ("-".join(names) or "default")
        assert main([*words, "-o", str(out), *names]) == 0
        answer = json.loads(capsys.readouterr().out)
        effects[names[-1:]] = [camera["effects"] for camera in answer["cameras"].values()]
        assert answer["effects"] == []
        assert Rig.load(out).names == ("left", "right")
    assert effects == {
        (): [["board_shape"]] * 2,
        ("none",): [[]] * 2,
        ("board_shape,detector_bias",): [["detector_bias", "board_shape"]] * 2,
    }


def with_pupil(rig: SimulatedRig, name: str, shift: float) -> SimulatedRig:
    """Return a rig without pictures whose camera of this name has a moving entrance pupil."""
    camera = rig.cameras[name]
    effect = EntrancePupil()
    values = {u.param.name: torch.zeros((), dtype=torch.float64) for u in effect.effect_parameters}
    values[PUPIL] = values[PUPIL] + shift
    moved = replace(camera, path=effect.apply(camera.path), values={**camera.values, **values})
    return replace(rig, cameras={**rig.cameras, name: moved})


def test_an_effect_of_a_camera_is_its_own(tmp_path: Path) -> None:
    rng = np.random.default_rng(8)
    made = simulate_rig(8, Cover("none", {}), placements=1, amplitude=0.0, depths=NEAR)
    made = with_pictures(rng, with_pupil(made, "right", 4e-3), 14, NEAR)
    rig = fit_rig(made.write(tmp_path / "rig"), EVEN, effects=("entrance_pupil",))
    estimates = {}
    for name, calibration in rig.calibrations.items():
        (added,) = calibration.effects
        estimates[name] = added.parameters[PUPIL]
    value, sigma = estimates["right"]
    assert abs(value - 4e-3) < 3 * sigma < 3e-3
    value, sigma = estimates["left"]
    assert abs(value) < 3 * sigma
    points, pixels = made.points(3, 200)
    pairs = np.arange(200).reshape(-1, 2)
    true = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    length, sigma = Rig.load(rig.save(tmp_path / "out")).distances(pixels, pairs, 0.0)
    assert 0.3 < rms((length - true) / sigma) < 2


@pytest.mark.slow
def test_bends_belong_to_the_placements(tmp_path: Path) -> None:
    rng = np.random.default_rng(102)
    bare = simulate_rig(102, WINDOW, placements=12, amplitude=0.0, board=SHEET)
    file = with_bends(rng, bare, BEND).write(tmp_path / "rig")
    rig = fit_rig(file, EVEN, effects=("board_flex",))
    assert all(c.stages[-1].rms_px < 0.15 for c in rig.calibrations.values())
    assert rig.bends.shape == (12, 12)
    assert 0.5 * BEND < rms(rig.bends[:, :3]) < 2 * BEND
    loaded = Rig.load(rig.save(tmp_path / "out"))
    state = state_of(loaded)
    for index, calibration in enumerate(loaded.calibrations.values()):
        assert np.allclose(state.poses(index).numpy(), calibration.poses, atol=1e-12)
    points, pixels = bare.points(5, 200)
    pairs = np.arange(200).reshape(-1, 2)
    true = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    length, sigma = loaded.distances(pixels, pairs, 0.0)
    assert 0.3 < rms((length - true) / sigma) < 2


def test_what_a_rig_cannot_have_is_refused(pair_folder: Path) -> None:
    sessions = read_rig(pair_folder).sessions
    with pytest.raises(InputError, match="rolling_shutter: the fit of a rig has no numbers"):
        fit_rig(pair_folder, EVEN, effects=("rolling_shutter",))
    with pytest.raises(InputError, match=r"^left: .*with cover.shape: flat there can be no"):
        requested_by_camera(sessions, {}, EVEN, ("board_shape", "cover_radius"))
    with pytest.raises(InputError, match="no numbers for wedge of a shared cover"):
        requested_by_camera(sessions, {"right": "left"}, EVEN, ("wedge",))
    shared = requested_by_camera(sessions, {"right": "left"}, EVEN, ("detector_bias",))
    assert shared == {"left": ("detector_bias",), "right": ("detector_bias",)}


def test_only_the_cameras_that_can_have_an_effect_get_it(pair_folder: Path) -> None:
    sessions = dict(read_rig(pair_folder).sessions)
    sessions["right"] = replace(sessions["right"], cover=Cover("none", {}))
    assert requested_by_camera(sessions, {}, Settings(), ("wedge", "board_shape")) == {
        "left": ("wedge", "board_shape"),
        "right": ("board_shape",),
    }


@pytest.mark.slow
def test_auto_is_the_diagnosis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = np.random.default_rng(103)
    bare = simulate_rig(103, WINDOW, placements=16, amplitude=0.0, board=SHEET)
    folder = with_bends(rng, bare, BEND).write(tmp_path / "rig").parent
    words = ["rig", "fit", str(folder), "--grid", "1x1"]
    assert main([*words, "-o", str(tmp_path / "auto"), "--effects", "auto"]) == 0
    assert "Found: board_flex" in capsys.readouterr().out
    assert main([*words, "-o", str(tmp_path / "plain")]) == 0
    assert main(["rig", "diagnose", str(tmp_path / "plain")]) == 0
    auto, diagnosed = Rig.load(tmp_path / "auto"), Rig.load(tmp_path / "plain" / "diagnosed")
    sentences = [[e.sentence for e in rig.record.effects] for rig in (auto, diagnosed)]
    assert sentences[0] == sentences[1]
    sigmas = [np.sqrt(np.diag(rig.covariance)) for rig in (auto, diagnosed)]
    assert np.allclose(sigmas[0], sigmas[1], rtol=1e-3), "the files round what the fit knows"
