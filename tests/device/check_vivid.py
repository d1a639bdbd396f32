"""A camera that fails: each fault is told in a sentence, with exit code 4, and costs nothing that
was recorded.
"""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from calib.io.frames_table import read_table
from calib.io.images import list_images, read_grey
from tests.device.guest import Guest
from tests.device.kernels import kernel_6_1

ONE_WEBCAM = "n_devs=1 node_types=0x1 num_inputs=1 input_types=0"


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that the guest wrote: result.json and the sessions that it recorded."""
    folder = tmp_path_factory.mktemp("vivid")
    Guest(kernel_6_1(), {"vivid": ONE_WEBCAM}, counted=True).run(
        folder, sys.executable, "-m", "tests.device.inside.vivid", "/shared"
    )
    return folder


@pytest.fixture(scope="module")
def steps(shared: Path) -> dict[str, Any]:
    result: dict[str, Any] = json.loads((shared / "result.json").read_text())
    return result


def test_a_stream_waits_for_its_camera_and_goes_on(steps: dict[str, Any]) -> None:
    step = steps["streamed"]
    assert step["ended"] == "interrupted"
    assert step["frames"] == 10
    assert step["interruptions"] == 1
    gone = "/dev/video0 was unplugged: the stream goes on when the camera is back."
    assert gone in step["sentences"]
    assert step["sentences"][-1].startswith("The camera is back, after ")
    assert step["shapes"] == [[180, 320, 3]], "in colour"


def test_unplugging_is_reported_within_two_seconds(steps: dict[str, Any]) -> None:
    step = steps["unplugged"]
    assert step["code"] == 4
    assert (
        "/dev/video0 was unplugged: plug the camera in again, and run the same command to continue."
        in step["stderr"]
    )
    assert step["seconds"] < 2


def test_a_camera_that_is_still_unplugged_is_refused(steps: dict[str, Any]) -> None:
    step = steps["unplugged"]["again"]
    assert step["code"] == 4
    assert "/dev/video0 is not connected any more" in step["stderr"]
    assert step["pictures"] == steps["unplugged"]["pictures"]


def test_plugging_in_again_continues_and_every_frame_is_intact(
    steps: dict[str, Any], shared: Path
) -> None:
    """Digests of the pictures: those from before the fault are still the same files."""
    earlier, at_the_end, step = (
        steps["unplugged"]["before"],
        steps["unplugged"]["pictures"],
        steps["plugged_in_again"],
    )
    assert step["code"] == 0, step["stderr"]
    assert len(earlier) >= 5
    assert earlier.items() <= at_the_end.items() <= step["pictures"].items()
    assert len(step["pictures"]) == len(at_the_end) + 3
    session = shared / "sessions" / "unplugged"
    names = [picture.name for picture in list_images(session / "frames")]
    assert (
        [row["file"] for row in read_table(session / "frames.csv")]
        == names
        == list(step["pictures"])
    )
    assert {read_grey(session / "frames" / name).shape for name in names} == {(180, 320)}


def test_dropped_buffers_show_as_gaps(steps: dict[str, Any], shared: Path) -> None:
    """The driver drops half of them; the same camera without that loses at most what a busy machine
    costs.
    """
    for name in ("dropped", "whole"):
        assert steps[name]["code"] == 0, steps[name]["stderr"]
    dropped = steps["dropped"]["summary"]["frames_lost"]
    lost_frames = steps["whole"]["summary"]["frames_lost"]
    assert dropped >= 5
    assert lost_frames < dropped / 2
    rows = read_table(shared / "sessions" / "dropped" / "frames.csv")
    counters = [int(row["sequence"]) for row in rows]
    passed_over = steps["dropped"]["summary"]["frames_passed_over"]
    assert counters[-1] - counters[0] + 1 - len(counters) == pytest.approx(dropped, abs=passed_over)


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (
            "silent",
            "can be opened but sends no pictures: plug the camera in again, into a port of its own",
        ),
        (
            "refusing",
            (
                "opens but does not stream (Invalid argument): plug the camera in again, or choose"
                " another mode"
            ),
        ),
    ],
    ids=("silent", "refusing"),
)
def test_a_camera_that_opens_but_does_not_stream_is_refused(
    steps: dict[str, Any], fault: str, reason: str
) -> None:
    assert steps[fault]["code"] == 4
    assert f"capture: error: /dev/video0 {reason}" in steps[fault]["stderr"]
    assert steps[fault]["pictures"] == {}
