"""The window in the terminal: it draws the pictures, and its keys change the view."""

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from textual.pilot import Pilot

from calib.calibration import Calibration
from capture.sources.folder import FolderSource
from capture.streaming.depth_file import DepthFile
from capture.streaming.straightener import Straightener
from capture.streaming.stream import Stream
from capture.streaming.view import StreamView
from capture.tui.picture import Picture
from capture.tui.stream_window import StreamApp
from tests.capture.recordings import write_recording
from tests.capture.tui.driving import drive, see, until

LONG_S = 60.0
"""The time in s between two frames: the test ends before the second."""


@pytest.fixture
def slow(pictures: list[np.ndarray], tmp_path: Path) -> Path:
    """A camera that sends its first frame at once, and the second much later."""
    return write_recording(tmp_path, pictures[:3], LONG_S)


def opened(
    calibration: Calibration,
    folder: Path,
    *,
    fixed_size: bool = False,
    depth_image: Path | None = None,
) -> StreamApp:
    app = StreamApp()
    straightener = Straightener(
        calibration,
        StreamView(None if depth_image else 0.5),
        fixed_size=fixed_size,
        depth_file=DepthFile(depth_image, 0.1, app.tell) if depth_image else None,
        tell=app.tell,
    )
    app.attach(Stream(partial(FolderSource, folder, 1.0), straightener, [app], app), straightener)
    return app


def run(app: StreamApp, story: Callable[[Pilot], object]) -> None:
    async def running() -> None:
        async with app.run_test(size=(80, 24)) as pilot:
            await story(pilot)  # type: ignore[misc]

    drive(running())


def test_the_picture_is_drawn_and_keys_change_the_view(
    calibration: Calibration, slow: Path
) -> None:
    app = opened(calibration, slow)

    async def story(pilot: Pilot) -> None:
        await see(pilot, "straight at 0.5 m, crop as the camera, scale 1, 328x246 px")
        picture = app.query_one(Picture)
        await until(pilot, lambda: picture.preview is not None)
        assert picture.preview
        assert picture.preview.size == (328, 246)
        await see(pilot, "1 frame,")
        assert app._straightener
        await pilot.press("up", "up", "c", "minus")
        assert app._straightener.requested == StreamView(0.605, None, 0.8).changed({"crop": 0.0})
        await pilot.press("down", "c", "plus")
        app._straightener.wait()
        assert app._straightener.view == StreamView(0.55, 0.25, 1.0)
        await pilot.press("q")
        await until(pilot, lambda: app._exit)

    run(app, story)
    assert app.return_value == "interrupted"
    assert app.error is None


def test_a_size_that_is_fixed_is_told(calibration: Calibration, slow: Path) -> None:
    app = opened(calibration, slow, fixed_size=True)

    async def story(pilot: Pilot) -> None:
        await pilot.press("minus")
        await see(pilot, "the pictures of this stream keep their size")
        await see(pilot, "No picture has come for")
        await pilot.press("ctrl+c")
        await until(pilot, lambda: app._exit)

    run(app, story)
    assert app.return_value == "interrupted"


def test_a_depth_image_has_no_depth_to_change(
    calibration: Calibration, slow: Path, tmp_path: Path
) -> None:
    path = tmp_path / "depth.npy"
    np.save(path, np.full((246, 328), 0.5, np.float32))
    app = opened(calibration, slow, depth_image=path)

    async def story(pilot: Pilot) -> None:
        await see(pilot, "straight by the depth image, crop as the camera, scale 1, 328x246 px")
        await pilot.press("up")
        await see(pilot, "Each pixel has its own depth.")
        await pilot.press("q")
        await until(pilot, lambda: app._exit)

    run(app, story)


def test_the_end_of_the_source_ends_the_window(calibration: Calibration, recording: Path) -> None:
    app = opened(calibration, recording)

    async def story(pilot: Pilot) -> None:
        await until(pilot, lambda: app._exit)

    run(app, story)
    assert app.return_value == "source"


def test_an_error_of_the_source_is_kept_for_the_command(
    calibration: Calibration, tmp_path: Path
) -> None:
    app = opened(calibration, write_recording(tmp_path, [np.zeros((24, 32), np.uint8)]))

    async def story(pilot: Pilot) -> None:
        await until(pilot, lambda: app._exit)

    run(app, story)
    assert "32x24 px where the calibration is for" in str(app.error)
