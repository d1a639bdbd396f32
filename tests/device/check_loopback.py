"""A camera that shows a fixture: what `capture record` keeps of it is the fixture, bit for bit, and
calibrates like it; so do two cameras, the second one later by a known time.
"""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from calib.io.images import list_images, read_grey
from capture.sources.v4l2_formats import FORMATS
from tests.device.guest import PROJECT, Guest
from tests.device.kernels import kernel_6_1, v4l2loopback

FIXTURE = PROJECT / "fixtures" / "bumps"
PAIR = PROJECT / "fixtures" / "rig-cones"


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that the guest wrote: result.json and the session that it recorded."""
    folder = tmp_path_factory.mktemp("loopback")
    kernel = kernel_6_1()
    guest = Guest(kernel, {"v4l2loopback": "devices=2"}, (v4l2loopback(kernel),))
    patient = {
        "OPENCV_VIDEOIO_V4L_SELECT_TIMEOUT": "10"
    }  # s: the next frame comes when this one is recorded, however slow the guest
    guest.run(
        folder,
        sys.executable,
        "-m",
        "tests.device.inside.loopback",
        str(FIXTURE),
        str(PAIR),
        "/shared",
        **patient,
    )
    return folder


def test_every_format_gives_the_grey_values_that_were_sent(shared: Path) -> None:
    formats = json.loads((shared / "result.json").read_text())["formats"]
    assert formats == dict.fromkeys(FORMATS, 0)


def test_every_view_is_kept_bit_for_bit(shared: Path) -> None:
    result = json.loads((shared / "result.json").read_text())
    assert result["code"] == 0, result["stderr"]
    recorded = list_images(shared / "session" / "frames")
    shown = list_images(FIXTURE / "frames")
    assert len(recorded) == len(shown)
    for ours, theirs in zip(recorded, shown, strict=True):
        np.testing.assert_array_equal(
            read_grey(ours), read_grey(theirs), err_msg=f"{ours.name} is not {theirs.name}"
        )


def test_a_camera_slower_than_a_frame_a_second_is_waited_for(shared: Path) -> None:
    slow = json.loads((shared / "result.json").read_text())["slow"]
    assert slow["code"] == 0, slow["stderr"]
    assert len(slow["pictures"]) == 3
    assert "waiting for the next one." in slow["stderr"]


def test_a_stream_to_the_device_is_a_camera_for_others(shared: Path) -> None:
    streamed = json.loads((shared / "result.json").read_text())["streamed"]
    assert streamed["opencv"] <= 3, "grey levels, of 219"
    assert streamed["colour"] <= 3
    assert (streamed["format"], streamed["size"]) == ("YU12", [320, 240])


def test_the_recording_calibrates_to_the_same_numbers(shared: Path, tmp_path: Path) -> None:
    shutil.copytree(FIXTURE / "frames", tmp_path / "fixture" / "frames")
    shutil.copy(FIXTURE / "session.yaml", tmp_path / "fixture")
    assert _fit(shared / "session", tmp_path / "recorded") == _fit(
        tmp_path / "fixture", tmp_path / "shown"
    )


def test_pictures_of_two_devices_are_paired_as_they_were_shown(shared: Path) -> None:
    """The first moment is there several times, as it is shown until it is recorded."""
    result = json.loads((shared / "result.json").read_text())["rig"]
    assert result["code"] == 0, result["stderr"]
    numbers = _shown_numbers(shared / "rig" / "left", PAIR / "left")
    assert numbers == _shown_numbers(shared / "rig" / "right", PAIR / "right")
    assert numbers == sorted(numbers)
    assert set(numbers) == set(range(len(list_images(PAIR / "left" / "frames"))))


def _shown_numbers(recorded: Path, shown: Path) -> list[int]:
    """Return for each recorded picture the number of the shown one that it is, bit for bit."""
    pictures = [read_grey(path).tobytes() for path in list_images(shown / "frames")]
    return [pictures.index(read_grey(path).tobytes()) for path in list_images(recorded / "frames")]


def test_the_time_between_two_devices_is_measured(shared: Path) -> None:
    """To 2 ms: a frame has its time when the driver has copied it."""
    result = json.loads((shared / "result.json").read_text())["rig"]
    written_ms = 1000 * float(np.median(result["offsets_s"]))
    found_ms = result["summary"]["cameras"]["right"]["offset_ms"]
    assert found_ms == pytest.approx(written_ms, abs=2.0)


def test_the_recorded_rig_calibrates(shared: Path, tmp_path: Path) -> None:
    """The distance between the cameras is right within 2.5 of its sigmas."""
    command = ["rig", "fit", str(shared / "rig"), "-o", str(tmp_path / "rig"), "--json"]
    done = subprocess.run(
        [sys.executable, "-m", "calib", *command], stdout=subprocess.PIPE, text=True, check=True
    )
    (baseline,) = json.loads(done.stdout)["baselines"]
    truth = float(np.linalg.norm(np.load(PAIR / "truth.npz")["moved"][1]))
    assert abs(baseline["metres"]["value"] - truth) < 2.5 * baseline["metres"]["sigma"]


def _fit(session: Path, output: Path) -> dict[str, Any]:
    """Return the output of `calib fit` without the time it took and the paths that it wrote."""
    command = [sys.executable, "-m", "calib", "fit", str(session), "-o", str(output), "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    result: dict[str, Any] = json.loads(done.stdout)
    del result["seconds"], result["written"], result["calibration"], result["verdict"]["next"]
    return result
