"""A killed recording of a rig loses no picture, and the same command goes on with it; a recorded
pair calibrates.
"""

import random
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from calib.cli import main as calib
from calib.rig.rig import Rig
from capture.cli import main as capture
from tests.capture.recordings import read_pictures
from tests.capture.rig.pair_recordings import BOARD_FLAGS, MODEL, REST_S, record, resting

pytestmark = pytest.mark.slow
KILLS = 6


@pytest.fixture(scope="module")
def sources(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Write what two cameras see of a board in 16 places."""
    rng = np.random.default_rng(2)
    places: list[np.ndarray] = []
    while len(places) < 16:
        turn, shift = rng.uniform(-0.5, 0.5, 2), rng.uniform(-0.25, 0.25, 2)
        place = np.array([*turn, rng.uniform(-0.1, 0.1), *shift, rng.uniform(0.4, 1.0)])
        pixels = [MODEL.project(name, place) for name in MODEL.cameras]
        if all((p > 25).all() and (p < [615, 455]).all() for p in pixels):
            places.append(place)
    folder = tmp_path_factory.mktemp("cameras")
    options = []
    for name, offset in (("left", 0.0), ("right", 0.008)):
        times = [k / 10 + offset for k in range(round(len(places) * REST_S * 10))]
        record(folder / name, name, times, resting(places))
        options += ["--source", f"{name}=folder:{folder / name}?speed=max"]
    return options


def test_a_killed_recording_goes_on(sources: list[str], tmp_path: Path) -> None:
    rig, rng = tmp_path / "pair", random.Random(3)
    command = [sys.executable, "-m", "capture", "record", str(rig), *sources, *BOARD_FLAGS]
    counts = [0]
    for _ in range(KILLS):
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
        assert process.stdout
        process.stdout.readline()  # a picture is kept, or nothing new was there
        time.sleep(rng.uniform(0, 0.3))
        process.kill()
        process.communicate()
        folders = [rig / name / "frames" for name in ("left", "right")]
        counts.append(min(len(read_pictures(folder)) for folder in folders))
        assert counts[-1] >= counts[-2]
    assert capture(["record", str(rig), *sources]) in (0, 3)
    pictures = [
        sorted(p.name for p in (rig / name / "frames").glob("*.png")) for name in MODEL.cameras
    ]
    shared = set(pictures[0]) & set(pictures[1])
    assert len(shared) == 16
    assert not list(rig.rglob("*.tmp"))


def test_a_recorded_pair_calibrates(sources: list[str], tmp_path: Path) -> None:
    """The way of docs/rigs.md, whose printed lines are of these pictures."""
    rig = tmp_path / "pair"
    assert capture(["record", str(rig), *sources, *BOARD_FLAGS]) == 0
    assert calib(["rig", "fit", str(rig), "-o", str(rig / "calibration")]) == 0
    pictures = [str(rig / name / "frames" / "0003.png") for name in MODEL.cameras]
    options = ["--depths", "0.4", "1.5", "-o", str(rig / "depth")]
    assert calib(["rig", "depth", str(rig / "calibration"), *pictures, *options]) == 0
    baseline = Rig.load(rig / "calibration").baselines[0]
    truth = float(np.linalg.norm(MODEL.mountings["right"][3:]))
    assert abs(baseline.metres - truth) < 5e-5
