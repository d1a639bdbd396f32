"""libcamera's own stack, with a virtual camera that shows a fixture: what its source streams is the
fixture.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from calib.io.frames_table import read_table
from calib.io.images import list_images, read_grey
from tests.device.guest import PROJECT, Guest
from tests.device.kernels import kernel_6_12, libcamera_root
from tests.device.wheels import capture_wheels

FIXTURE = PROJECT / "fixtures" / "bumps"
pytestmark = pytest.mark.slow
DECODED = 8
"""Grey levels: libcamera decodes and scales the fixture's JPEGs by other code than OpenCV's, which
differs by 5 at the most.
"""
PER_PICTURE = 4
"""Frames for which the virtual camera shows one picture: as many as there are buffers."""


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder that the guest wrote: result.json and the session that it recorded."""
    folder = tmp_path_factory.mktemp("libcamera")
    imports = f"/host{PROJECT}:/host{capture_wheels()}"
    guest = Guest(kernel_6_12(), {}, root=libcamera_root())
    guest.run(
        folder,
        "python3",
        "-m",
        "tests.device.inside.libcamera",
        f"/host{FIXTURE}",
        "/shared",
        PYTHONPATH=imports,
    )
    return folder


def test_the_guest_records_a_session(shared: Path) -> None:
    result = json.loads((shared / "result.json").read_text())
    assert result["code"] == 0, result["stderr"]
    assert len(result["pictures"]) == 24


def test_each_frame_is_the_fixtures_view_that_was_shown_then(shared: Path) -> None:
    """Whole, not torn between two views, and with the counter of its own exposure."""
    views = [read_grey(picture).astype(int) for picture in list_images(FIXTURE / "frames")]
    for row in read_table(shared / "session" / "frames.csv"):
        frame = read_grey(shared / "session" / "frames" / row["file"]).astype(int)
        furthest = [int(np.abs(frame - view).max()) for view in views]
        shown = int(np.argmin(furthest))
        assert furthest[shown] <= DECODED, f"{row['file']} is none of the fixture's views"
        assert int(row["sequence"]) // PER_PICTURE % len(views) == shown
