"""The sources of frames: the frames of each, and the sentence of each that can give none."""

import os
import stat
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.errors import InputError, RefracalError
from capture.errors import CaptureError
from capture.sources.registry import SCHEMES, Scheme, full_source, open_source
from tests.capture.recordings import FIXTURE, noise, write_recording


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (
            "",
            (
                "--source is empty: write one of v4l2:/dev/video0, libcamera:0, rpicam:0,"
                " folder:PATH, video:FILE"
            ),
        ),
        ("/dev/video0", "did you mean v4l2:/dev/video0?"),
        ("video2", "did you mean v4l2:/dev/video2?"),
        ("0", "did you mean v4l2:/dev/video0?"),
        ("vl42:/dev/video0", "did you mean v4l2?"),
        ("folders:x", "did you mean folder?"),
        ("folder:", "does not say which one: write it like folder:PATH"),
        ("v4l2:?size=1x1", "does not say which one"),
        ("folder:x?sped=2", "sped is not a known option (did you mean speed?)"),
        ("folder:x?speed=fast", 'speed is the text "fast": write a number from 0.01 to 1000'),
        ("folder:x?speed=0", "write a number from 0.01 to 1000"),
        ("folder:x?speed=nan", "write a number"),
        ("folder:x?speed=1&speed=2", "is not an option"),
        ("folder:x?speed=", "is not an option"),
        ("video:x?speed=1", "a video has no options: leave out what follows the question mark"),
        (
            "v4l2:/dev/video0?size=big",
            'size is the text "big": write width and height in px, such as 1640x1232',
        ),
        ("v4l2:/dev/video0?size=12", "size is 12"),
        ("v4l2:/dev/video0?format=YUV", "YUYV, or one of GREY"),
        ("rpicam:zero", "names no camera: write its number, such as rpicam:0"),
        (f"rpicam:{'9' * 5000}", "names no camera: write its number, such as rpicam:0"),
        ("rpicam:0?gain=-1", "gain is -1.0: write a number from 1 to 1000"),
        ("rpicam:0?mode=big", 'mode is the text "big": write it like 3280:2464:10:P'),
        ("libcamera:0?lens_positon=1", "did you mean lens_position?"),
    ],
)
def test_a_source_that_is_written_wrongly_gets_its_sentence(text: str, says: str) -> None:
    with pytest.raises(InputError) as caught:
        open_source(text)
    assert says in str(caught.value)


def test_a_path_that_exists_is_a_source_by_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recorded" / "frames").mkdir(parents=True)
    (tmp_path / "film.mkv").touch()
    for text, full in (
        ("recorded/frames", "folder:recorded/frames"),
        ("recorded?speed=max", "folder:recorded?speed=max"),
        (str(tmp_path), f"folder:{tmp_path}"),
        ("film.mkv", "video:film.mkv"),
        ("/dev/null", "v4l2:/dev/null"),
        ("folder:film.mkv", "folder:film.mkv"),
    ):
        assert full_source(text) == full
        assert type(open_source(text)) is type(open_source(full))
    for text in ("nowhere", "a\0b", "n" * 5000):
        with pytest.raises(InputError, match="names no kind of source: write one of"):
            open_source(text)


@pytest.mark.parametrize(
    "text", ["", "webcam:0", "folder:", "folder:x?sped=2", "folder:x?speed=", "video:x?speed=1"]
)
def test_errors_of_a_field_name_the_field_and_no_option(text: str) -> None:
    with pytest.raises(InputError, match=r"^source ") as caught:
        open_source(text, "source")
    assert "--" not in str(caught.value)


@pytest.mark.parametrize("text", ["folder:~/pictures?speed=max", "video:~/film.mkv"])
def test_a_tilde_is_the_home(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    with pytest.raises(InputError, match=f"^{tmp_path / 'home'}/.*cannot be"), open_source(text):
        pass


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda scheme: scheme.name)
def test_every_example_is_understood_and_opens_nothing(scheme: Scheme) -> None:
    open_source(scheme.example)


@pytest.mark.parametrize("scheme", SCHEMES, ids=lambda scheme: scheme.name)
def test_every_backend_lists_its_cameras(scheme: Scheme) -> None:
    result = scheme.backend().inventory()
    assert result.missing == "" or result.missing.endswith(".")
    assert not (result.missing and result.cameras)
    for camera in result.cameras:
        assert camera.source.startswith(f"{scheme.name}:")
        open_source(camera.source)


def test_a_counter_of_5000_digits_counts_as_none(tmp_path: Path) -> None:
    write_recording(tmp_path, noise(2), 0.05, "9" * 5000)
    table = tmp_path / "frames.csv"
    head, *rows = table.read_text().splitlines()
    counter = head.split(",").index("sequence")
    cells = [row.split(",") for row in rows]
    for row in cells:
        row[counter] = "9" * 5000
    table.write_text("\n".join([head, *map(",".join, cells)]) + "\n")
    with open_source(f"folder:{tmp_path}?speed=max") as source:
        assert [frame.sequence for frame in source] == [0, 1]


def test_a_recorded_session_is_given_again_with_times_and_state(tmp_path: Path) -> None:
    pictures = noise(5)
    write_recording(tmp_path, pictures, 0.05, "2.5")
    for speed, seconds in (("", 0.2), ("?speed=4", 0.05)):
        start_s = time.monotonic()
        with open_source(f"folder:{tmp_path}{speed}") as source:
            assert source.live
            frames = list(source)
        assert seconds < time.monotonic() - start_s < seconds + 0.3
        assert all(
            np.array_equal(frame.pixels, picture)
            for frame, picture in zip(frames, pictures, strict=True)
        )
        assert np.allclose(
            np.diff([frame.time_s for frame in frames]), 0.05
        )  # else a fast replay would be a board in fast motion
        assert start_s <= frames[0].time_s <= time.monotonic()
    assert [frame.sequence for frame in frames] == [0, 1, 2, 3, 4]
    assert [frame.metadata for frame in frames] == [{"gain": 2.5}] * 5
    assert frames[3].name == "0003.png"


def test_a_recording_as_fast_as_it_is_read_keeps_its_times(tmp_path: Path) -> None:
    write_recording(tmp_path, noise(3), 5.0)
    start_s = time.monotonic()
    with open_source(f"folder:{tmp_path}?speed=max") as source:
        assert not source.live
        frames = list(source)
    assert time.monotonic() - start_s < 2
    assert np.allclose(np.diff([frame.time_s for frame in frames]), 5.0)


def test_pictures_without_times_are_given_as_they_are_read(tmp_path: Path) -> None:
    pictures = noise(3)
    write_recording(tmp_path, pictures)
    for folder in (tmp_path, tmp_path / "frames"):
        with open_source(f"folder:{folder}") as source:
            assert not source.live
            assert [frame.name for frame in source] == ["0000.png", "0001.png", "0002.png"]
    with open_source(f"folder:{FIXTURE}") as source:
        assert next(iter(source)).size == (1640, 1232)


def test_a_first_picture_without_a_time_does_not_shift_the_others(tmp_path: Path) -> None:
    write_recording(tmp_path, noise(3), 0.5)
    table = tmp_path / "frames.csv"
    table.write_text(table.read_text().replace("0000.png,1000.0", "0000.png,"))
    with open_source(f"folder:{tmp_path}") as source:
        frames = list(source)
    assert [frame.isolated for frame in frames] == [True, False, False]
    assert np.ptp([frame.time_s for frame in frames]) < 1


def test_a_lossless_video_is_given_frame_by_frame(tmp_path: Path) -> None:
    pictures = noise(4)
    file = str(tmp_path / "video.avi")
    writer = cv2.VideoWriter(file, cv2.VideoWriter.fourcc(*"FFV1"), 10.0, (160, 120), True)
    assert writer.isOpened()
    for picture in pictures:
        writer.write(np.dstack([picture] * 3))
    writer.release()
    with open_source(f"video:{file}") as source:
        assert not source.live
        frames = list(source)
    assert all(
        np.array_equal(frame.pixels[..., 1], picture)
        for frame, picture in zip(frames, pictures, strict=True)
    )
    assert np.allclose(np.diff([frame.time_s for frame in frames]), 0.1)


def test_a_truncated_video_gives_its_complete_frames_and_an_error(tmp_path: Path) -> None:
    file = tmp_path / "video.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"FFV1"), 10.0, (160, 120), True)
    for picture in noise(8):
        writer.write(np.dstack([picture] * 3))
    writer.release()
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with open_source(f"video:{file}") as source:
        frames = iter(source)
        assert [next(frames).sequence for _ in range(3)] == [0, 1, 2]
        with pytest.raises(InputError, match=r"breaks off after [34] of 8 frames: copy it again"):
            list(frames)


@pytest.mark.parametrize(
    ("text", "kind", "says"),
    [
        ("folder:{}/none", InputError, "none cannot be listed (No such file or directory)"),
        (f"folder:{300 * 'a'}", InputError, "cannot be read (File name too long)"),
        (
            "folder:{}",
            InputError,
            "has no pictures that are read: name a session, or a folder of png",
        ),
        ("folder:{}/deep", InputError, "has 16 bits a pixel"),
        ("video:{}/none.mp4", InputError, "none.mp4 cannot be read (No such file or directory)"),
        ("video:{}/plain", InputError, "plain is not a video that can be read"),
        ("video:{}", InputError, "cannot be read (Is a directory)"),
        ("v4l2:{}/video9", CaptureError, "video9 is not there: plug the camera in"),
        ("v4l2:{}/plain", CaptureError, "plain is not a device"),
        ("v4l2:{}", CaptureError, "is not a device"),
        (
            "v4l2:/dev/null",
            CaptureError,
            "/dev/null is not a camera: `capture sources` lists the cameras",
        ),
        ("v4l2:{}/gone", CaptureError, "gone is not connected any more: plug the camera in again"),
        (
            "rpicam:0",
            CaptureError,
            (
                "rpicam-vid cannot be started (No such file or directory): on Raspberry Pi OS, run"
                " sudo apt install"
            ),
        ),
        (
            "libcamera:0",
            CaptureError,
            "The libcamera bindings are not installed: run sudo apt install -y python3-libcamera",
        ),
    ],
)
def test_a_source_that_cannot_be_opened_gets_a_sentence(
    tmp_path: Path, text: str, kind: type[RefracalError], says: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "plain").write_text("not a camera")
    (tmp_path / "deep").mkdir()
    cv2.imwrite(str(tmp_path / "deep" / "a.png"), np.zeros((4, 4), np.uint16))
    if "gone" in text:
        make_node(tmp_path / "gone")
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RefracalError) as caught, open_source(text.format(tmp_path)) as source:
        list(source)
    assert type(caught.value) is kind
    assert says in str(caught.value)
    assert "\n" not in str(caught.value)


def make_node(path: Path) -> None:
    """A device node without a driver."""
    try:
        os.mknod(path, 0o600 | stat.S_IFCHR, os.makedev(81, 63))
        os.close(os.open(path, os.O_RDWR))
    except PermissionError:
        pytest.skip("device nodes may not be made or opened here")
    except OSError:
        pass
