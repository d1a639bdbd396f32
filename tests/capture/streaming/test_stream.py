"""The way of a stream: every frame of a recording, the newest of a camera, and a camera that goes
away and comes back.
"""

import threading
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Self

import cv2
import numpy as np
import pytest

from calib.calibration import Calibration
from calib.errors import InputError
from capture.errors import CaptureError
from capture.sources import v4l2_device as device
from capture.sources.folder import FolderSource
from capture.sources.registry import open_source
from capture.streaming import stream as stream_module
from capture.streaming.statistics import StreamStatistics
from capture.streaming.straightener import Straightener
from capture.streaming.stream import Stream
from capture.streaming.target import ReaderGoneError, TargetError
from capture.streaming.view import StreamView
from fixtures.known import known
from fixtures.synthetic import scene
from tests.capture.recordings import write_recording
from tests.capture.streaming.conftest import COUNT
from tests.capture.streaming.listening import Remarks, wait_until
from tests.capture.test_v4l2 import Camera


class Album:
    """A target that keeps a copy of each picture."""

    def __init__(self, error: Exception | None = None) -> None:
        self.pictures: list[np.ndarray] = []
        self.opened = self.closed = False
        self.before: Callable[[], object] = lambda: None
        """Called before a picture is kept."""
        self._error = error

    def __enter__(self) -> Self:
        self.opened = True
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.closed = True

    def show(self, picture: np.ndarray) -> None:
        self.before()
        self.pictures.append(picture.copy())
        if self._error:
            raise self._error


class Waits(threading.Event):
    """An event that records for how long it is waited for."""

    def __init__(self) -> None:
        super().__init__()
        self.seconds: list[float] = []

    def wait(self, timeout: float | None = None) -> bool:
        self.seconds.append(timeout or 0.0)
        return self.is_set()


@pytest.mark.parametrize("paced", [True, False])
def test_a_film_is_shown_at_its_own_rate_to_people(
    calibration: Calibration, pictures: list[np.ndarray], tmp_path: Path, paced: bool
) -> None:
    film = str(tmp_path / "film.avi")
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(film, cv2.VideoWriter.fourcc(*"MJPG"), 0.1, (width, height))
    for picture in pictures[:3]:
        writer.write(picture if picture.ndim == 3 else cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    writer.release()
    straightener = Straightener(calibration, StreamView(0.5))
    source = partial(open_source, f"video:{film}")
    stream = Stream(source, straightener, [Album()], Remarks(), paced=paced)
    stream.stop = waits = Waits()
    assert stream.run() == "source"
    steps = [round(seconds / 10) for seconds in waits.seconds]
    assert steps == ([0, 1, 2] if paced else [])


def test_every_frame_of_a_recording_goes_to_every_target(
    calibration: Calibration, recording: Path, pictures: list[np.ndarray]
) -> None:
    straightener = Straightener(calibration, StreamView(0.5))
    albums = [Album(), Album()]
    stream = Stream(partial(FolderSource, recording, None), straightener, albums, Remarks())
    assert stream.run() == "source"
    undistorter = StreamView(0.5).undistorter(calibration)
    for album in albums:
        assert album.closed
        for straight, picture in zip(album.pictures, pictures, strict=True):
            np.testing.assert_array_equal(straight, undistorter.undistort(picture))
    counts = stream.statistics
    assert (counts.frames, counts.skipped, counts.camera_losses) == (COUNT, 0, 0)
    assert 0 < counts.latency_ms(50) <= counts.latency_ms(95)


def test_a_slow_target_gets_the_newest_frame_of_a_camera(
    calibration: Calibration, pictures: list[np.ndarray], tmp_path: Path
) -> None:
    """The target takes its first picture until the camera has sent five more."""
    folder = write_recording(tmp_path, pictures, 0.03)
    straightener = Straightener(calibration, StreamView(0.5))
    album = Album()
    stream = Stream(partial(FolderSource, folder, 1.0), straightener, [album], Remarks())

    def wait_for_frames() -> None:
        reader = stream._reader
        assert reader
        if not album.pictures:
            wait_until(lambda: reader.skipped >= 4, "four frames that nobody takes")

    album.before = wait_for_frames
    assert stream.run() == "source"
    newest = StreamView(0.5).undistorter(calibration).undistort(pictures[-1])
    np.testing.assert_array_equal(album.pictures[-1], newest)
    counts = stream.statistics
    assert counts.frames == len(album.pictures) <= COUNT - 4
    assert counts.frames + counts.skipped == COUNT


def test_gaps_in_the_camera_s_counter_are_counted(
    calibration: Calibration, pictures: list[np.ndarray], tmp_path: Path
) -> None:
    folder = write_recording(tmp_path, pictures, 0.01)
    (folder / "frames" / "0003.png").unlink()
    straightener = Straightener(calibration, StreamView(0.5))
    stream = Stream(partial(FolderSource, folder, None), straightener, [Album()], Remarks())
    assert stream.run() == "source"
    assert stream.statistics.camera_losses == 1
    assert "1 lost by the camera" in stream.statistics.line()


def test_the_reader_of_a_pipe_ends_the_stream_and_a_broken_target_is_an_error(
    calibration: Calibration, recording: Path
) -> None:
    straightener = Straightener(calibration, StreamView(0.5))
    source = partial(FolderSource, recording, None)
    assert Stream(source, straightener, [Album(error=ReaderGoneError())], Remarks()).run() == (
        "reader"
    )
    broken = Stream(source, straightener, [Album(error=TargetError("gone."))], Remarks())
    with pytest.raises(TargetError, match=r"gone\."):
        broken.run()


def test_frames_of_another_size_are_refused(calibration: Calibration, tmp_path: Path) -> None:
    write_recording(tmp_path, [np.zeros((48, 64), np.uint8)])
    straightener = Straightener(calibration, StreamView(0.5))
    stream = Stream(partial(FolderSource, tmp_path, None), straightener, [Album()], Remarks())
    with pytest.raises(InputError, match="64x48 px where the calibration is for 328x246"):
        stream.run()


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch) -> Camera:
    """A camera of 64x48 px whose driver is faked at the system call."""
    camera = Camera(0.0)
    monkeypatch.setattr(device, "ioctl", camera.ioctl)
    monkeypatch.setattr(cv2, "VideoCapture", lambda: camera)
    monkeypatch.setattr(stream_module, "RETRY_S", 0.05)
    return camera


@pytest.fixture(scope="module")
def small() -> Calibration:
    return known(scene(3, views=1, grid=(4, 4), amplitude=1e-5), 64, 48)


def test_a_camera_that_is_unplugged_is_waited_for(camera: Camera, small: Calibration) -> None:
    remarks = Remarks()
    straightener = Straightener(small, StreamView(0.5))
    source = partial(open_source, "v4l2:/dev/null", camera_options={"size": "64x48"})
    stream = Stream(source, straightener, [Album()], remarks)

    def script(counts: StreamStatistics) -> None:
        if counts.frames == 3:
            camera.plugged_in = False
            threading.Timer(0.5, setattr, (camera, "plugged_in", True)).start()
        if counts.frames == 6:
            stream.close()

    remarks.on_frame = script
    assert stream.run() == "interrupted"
    assert stream.statistics.interruptions == 1
    gone, back = remarks.sentences
    assert gone == "/dev/null was unplugged: the stream goes on when the camera is back."
    assert back.startswith("The camera is back, after ")


def test_a_camera_that_is_not_there_at_first_is_refused(camera: Camera, small: Calibration) -> None:
    """No target opens: no page's address is told."""
    camera.plugged_in = False
    straightener, album = Straightener(small, StreamView(0.5)), Album()
    stream = Stream(partial(open_source, "v4l2:/dev/null"), straightener, [album], Remarks())
    with pytest.raises(CaptureError, match="not connected any more: plug the camera in again"):
        stream.run()
    assert not album.opened


def test_the_stream_ends_while_it_waits_for_its_camera(camera: Camera, small: Calibration) -> None:
    remarks = Remarks()
    stream = Stream(
        partial(open_source, "v4l2:/dev/null"),
        Straightener(small, StreamView(0.5)),
        [Album()],
        remarks,
    )

    def unplug(_: object) -> None:
        camera.plugged_in = False

    def close_when_gone(sentence: str) -> None:
        remarks.sentences.append(sentence)
        stream.close()

    remarks.on_frame = unplug
    remarks.tell = close_when_gone  # type: ignore[method-assign]
    assert stream.run() == "interrupted"
    assert len(remarks.sentences) == 1


def test_a_camera_gets_the_calibrated_size_and_colours_unless_the_source_says_otherwise() -> None:
    options = {"size": "64x48", "colour": "yes"}
    source = open_source("v4l2:/dev/null", camera_options=options)
    assert source._size == (64, 48)  # type: ignore[attr-defined]
    source = open_source("v4l2:/dev/null?size=32x24", camera_options=options)
    assert source._size == (32, 24)  # type: ignore[attr-defined]
    assert open_source("video:film.mp4", camera_options=options)
