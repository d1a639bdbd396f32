"""The newest-frame rule: a slow user neither delays the camera nor is given an old picture."""

import threading
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Self

import numpy as np
import pytest

from calib.errors import InputError
from capture.frames import Frame
from capture.narrator import SilenceRemarks
from capture.reader import SILENT_S, Reader
from capture.sources.folder import FolderSource
from tests.capture.recordings import noise, write_recording

INTERVAL = 0.03  # s, of the recorded camera
DETECTION = 0.01  # s, of a detector that keeps up
# s, for a machine that does other things too; without the rule it is more than 1 s after 15 frames
SLACK = 0.15


def worst_age(frames: Iterable[Frame], detection: float) -> float:
    """Return the seconds by which the oldest picture exceeds one detection and one frame at the
    moment of its decision.
    """
    worst = -np.inf
    for frame in frames:
        start_s = time.monotonic()
        time.sleep(detection)
        judged = time.monotonic()
        worst = max(worst, judged - frame.time_s - (judged - start_s) - INTERVAL)
    return float(worst)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recording(tmp_path_factory.mktemp("recorded"), noise(60, 64, 48), INTERVAL)


@pytest.mark.parametrize("slower", [1, 10])
def test_the_picture_judged_is_never_older_than_one_detection_plus_one_frame(
    recorded: Path, slower: int
) -> None:
    with Reader(FolderSource(recorded, 1.0)) as reader:
        assert worst_age(reader, slower * DETECTION) < SLACK
    assert reader.lost == 0
    assert (reader.skipped > 30) == (slower == 10)


def test_without_the_reader_pictures_grow_old(recorded: Path) -> None:
    with FolderSource(recorded, 1.0) as source:
        assert (
            worst_age((frame for frame, _ in zip(source, range(15), strict=False)), 10 * DETECTION)
            > 5 * SLACK
        )


def test_a_recording_waits_for_its_reader(recorded: Path) -> None:
    with Reader(FolderSource(recorded, None)) as reader:
        frames_seen = []
        for frame in reader:
            time.sleep(0.002)
            frames_seen.append(frame.sequence)
    assert frames_seen == list(range(60))
    assert reader.skipped == reader.lost == 0


def test_gaps_in_the_counter_are_counted(tmp_path: Path) -> None:
    write_recording(tmp_path, noise(10, 64, 48), 0.01)
    for number in (3, 4, 8):
        (tmp_path / "frames" / f"{number:04d}.png").unlink()
    with Reader(FolderSource(tmp_path, None)) as reader:
        assert [frame.sequence for frame in reader] == [0, 1, 2, 5, 6, 7, 9]
    assert reader.lost == 3


def test_pictures_that_a_recorder_skipped_do_not_count_as_lost(tmp_path: Path) -> None:
    write_recording(tmp_path, noise(4, 64, 48), 2.0)
    (tmp_path / "frames" / "0001.png").unlink()
    with Reader(FolderSource(tmp_path, None)) as reader:
        assert [frame.sequence for frame in reader] == [0, 2, 3]
    assert reader.lost == 0


def test_errors_of_the_thread_are_raised_after_the_good_frames(tmp_path: Path) -> None:
    write_recording(tmp_path, noise(5, 64, 48))
    broken = tmp_path / "frames" / "0003.png"
    broken.write_bytes(broken.read_bytes()[:100])
    with Reader(FolderSource(tmp_path, None)) as reader:
        frames = iter(reader)
        assert [next(frames).name for _ in range(3)] == ["0000.png", "0001.png", "0002.png"]
        with pytest.raises(InputError, match=r"0003.png is truncated or damaged"):
            next(frames)


@pytest.mark.slow
def test_waiting_for_a_slow_camera_is_reported(tmp_path: Path) -> None:
    write_recording(tmp_path, noise(3, 64, 48), 2.5)
    silences: list[float] = []
    with Reader(FolderSource(tmp_path, 1.0), silences.append) as reader:
        assert len(list(reader)) == 3
    assert len(silences) >= 2, "once before each of two frames, at the least"
    assert min(silences) >= SILENT_S
    assert min(silences) < 2 * SILENT_S, "the seconds are counted from the last frame"


def test_waiting_for_a_camera_to_open_is_reported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Slow(FolderSource):
        def __enter__(self) -> Self:
            assert reported.wait(60), "nothing was said"
            return super().__enter__()

    reported = threading.Event()
    monkeypatch.setattr("capture.reader.OPENING_S", 0.1)
    write_recording(tmp_path, noise(1, 64, 48))
    with Reader(Slow(tmp_path, None), lambda _: reported.set()) as reader:
        assert len(list(reader)) == 1


def test_a_recording_that_waits_for_its_reader_causes_no_report(tmp_path: Path) -> None:
    write_recording(tmp_path, noise(3, 64, 48), 2.5)
    silences: list[float] = []
    with Reader(FolderSource(tmp_path, None), silences.append) as reader:
        assert len(list(reader)) == 3
    assert silences == []


def test_the_console_says_a_silence_again_when_it_is_twice_as_long(
    capsys: pytest.CaptureFixture[str],
) -> None:
    waits = SilenceRemarks()
    for seconds in (1.0, 1.1, 1.9, 1.2, 2.1, 3.0, 4.3):
        waits(seconds)
    lines = capsys.readouterr().err.splitlines()
    assert lines == [
        f"No picture has come for {seconds} s: waiting for the next one." for seconds in (1, 2, 4)
    ]


def test_close_ends_the_iteration_from_another_thread(tmp_path: Path) -> None:
    write_recording(tmp_path, noise(2, 64, 48), 60.0)  # the second frame is a minute away
    with Reader(FolderSource(tmp_path, 1.0)) as reader:
        timer = threading.Timer(0.2, reader.close)
        timer.start()
        start_s = time.monotonic()
        assert len(list(reader)) == 1
        assert time.monotonic() - start_s < 2
        timer.join()
    assert not [thread for thread in threading.enumerate() if thread.name == "camera"]
