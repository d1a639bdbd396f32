"""Pictures through a pipe: whole for a reader that keeps up, and told where it does not."""

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.errors import InputError
from capture.streaming import pipe
from capture.streaming.pipe import PipeTarget
from capture.streaming.target import ReaderGoneError
from tests.capture.streaming.listening import HANGS_S, wait_until

SIZE = (64, 48)
COLOUR = np.full((48, 64, 3), (30, 160, 200), np.uint8)
GREY = np.tile(np.linspace(0, 255, 64).astype(np.uint8), (48, 1))


@pytest.fixture
def ends() -> Iterator[list[int]]:
    """The reading and the writing end; a test may close the first and set it to -1."""
    pair = list(os.pipe())
    yield pair
    for end in pair:
        if end >= 0:
            os.close(end)


def written(path: Path, pictures: list[np.ndarray], *, raw: bool = False) -> list[str]:
    """Write pictures into a file, and return what is told."""
    sentences: list[str] = []
    with path.open("wb") as file:
        target = PipeTarget(
            SIZE, threading.Event(), sentences.append, raw=raw, descriptor=file.fileno()
        )
        with target:
            for picture in pictures:
                target.show(picture)
    return sentences


def read_video(path: Path) -> list[np.ndarray]:
    video = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG)
    frames: list[np.ndarray] = []
    while True:
        success, frame = video.read()
        if not success:
            return frames
        frames.append(np.asarray(frame))


def test_opencv_reads_the_colours_of_a_y4m(tmp_path: Path) -> None:
    assert written(tmp_path / "v.y4m", [COLOUR, COLOUR[..., ::-1]]) == []
    frames = read_video(tmp_path / "v.y4m")
    assert len(frames) == 2
    np.testing.assert_allclose(frames[0].astype(int), COLOUR, atol=3)  # of 219 levels
    np.testing.assert_allclose(frames[1].astype(int), COLOUR[..., ::-1], atol=3)


def test_opencv_reads_the_greys_of_a_y4m(tmp_path: Path) -> None:
    written(tmp_path / "v.y4m", [GREY])
    (frame,) = read_video(tmp_path / "v.y4m")
    np.testing.assert_allclose(frame.astype(int), GREY[..., None].repeat(3, 2), atol=2)


@pytest.mark.parametrize(("picture", "name"), [(COLOUR, "bgr24"), (GREY, "gray")])
def test_raw_pictures_are_their_bytes(tmp_path: Path, picture: np.ndarray, name: str) -> None:
    sentences = written(tmp_path / "raw", [picture, picture], raw=True)
    assert (tmp_path / "raw").read_bytes() == 2 * picture.tobytes()
    (sentence,) = sentences
    assert sentence.startswith(f"Raw pictures of 64x48 px, {name}:")


def test_a_terminal_is_not_filled_with_pictures() -> None:
    terminal, ours = os.openpty()
    try:
        target = PipeTarget(SIZE, threading.Event(), print, descriptor=ours)
        with pytest.raises(InputError, match="would fill the terminal"):
            target.__enter__()
    finally:
        os.close(terminal)
        os.close(ours)


def test_a_reader_that_has_gone_ends_the_stream(ends: list[int]) -> None:
    with PipeTarget(SIZE, threading.Event(), print, descriptor=ends[1]) as target:
        target.show(COLOUR)
        os.close(ends[0])
        ends[0] = -1
        with pytest.raises(ReaderGoneError):
            target.show(COLOUR)


def test_a_reader_that_stalls_is_waited_for_and_gets_every_byte(
    ends: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipe, "STALL_S", 0.05)
    monkeypatch.setattr(pipe, "PIPE_BYTES", 1 << 12)
    sentences: list[str] = []
    target = PipeTarget(SIZE, threading.Event(), sentences.append, raw=True, descriptor=ends[1])
    with target:
        writer = threading.Thread(target=target.show, args=(COLOUR,))
        writer.start()
        wait_until(lambda: len(sentences) > 1, "the stall")
        assert sentences[1] == "The reader of the pipe takes no pictures: waiting for it."
        received = b""
        while len(received) < COLOUR.nbytes:
            received += os.read(ends[0], 1 << 16)
        writer.join(HANGS_S)
    assert received == COLOUR.tobytes()
    assert "takes pictures again, after" in sentences[2]
    assert len(sentences) == 3, "a stall is told once"


def test_the_end_of_a_stream_does_not_wait_for_a_reader_that_stalls(
    ends: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipe, "GRACE_S", 0.1)
    monkeypatch.setattr(pipe, "PIPE_BYTES", 1 << 12)
    stop = threading.Event()
    with PipeTarget(SIZE, stop, lambda _: None, raw=True, descriptor=ends[1]) as target:
        writer = threading.Thread(target=target.show, args=(COLOUR,))
        writer.start()
        stop.set()
        writer.join(HANGS_S)
        assert not writer.is_alive()


def test_the_pipe_blocks_again_for_others_afterwards(ends: list[int]) -> None:
    with PipeTarget(SIZE, threading.Event(), print, descriptor=ends[1]):
        assert not os.get_blocking(ends[1])
    assert os.get_blocking(ends[1])
