"""Import a video of a board: its sharpest frames, spread over its whole length."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.importing.session_draft import SessionDraft
from calib.io.images import Image
from calib.io.videos import breaks_off, convert_command, open_video, promised_frames
from calib.progress import Advance, Progress, Silent
from calib.session.board import Board
from calib.session.camera import Camera

MAX_FRAMES = 60
"""The number of frames that are kept: more views of one sweep of the board add little."""
SHARPNESS_SIDE = 960
"""px, the longer side of the picture in which sharpness is compared."""
PNG = [cv2.IMWRITE_PNG_COMPRESSION, 3]

Picture = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class VideoFrame:
    """A frame of a video."""

    number: int
    """The place in the video, from 0 on."""
    time_s: float
    """s from the beginning of the video."""
    pixels: Image
    """(H, W) grey or (H, W, 3) BGR as stored: not turned by what the file says of the camera's
    position.
    """
    sharpness: float


def from_video(
    path: Path, board: Board, model: str = "", progress: Progress | None = None
) -> SessionDraft:
    """Import the sharpest frame of each of MAX_FRAMES equal parts of a video.

    Raises:
        InputError: the file is no video that can be read.
    """
    width, height, count = _measure(path)
    frames = _encode(path, len(str(count)), progress or Silent())
    return SessionDraft(path, board, Camera(width, height, model), frames=frames)


def _measure(path: Path) -> tuple[int, int, int]:
    """Return width and height of a video's frames, px, and their number."""
    video = open_video(path)
    try:
        success, pixels = video.read()
        if not success:
            raise InputError(
                f"{path} is not a video that can be read: give a folder of its frames, or convert"
                f" it by `{convert_command(path)}`."
            )
        count = promised_frames(video, path)
        if not count:
            count = 1
            while video.grab():
                count += 1
    finally:
        video.release()
    height, width = pixels.shape[:2]
    return width, height, count


def describe_end(path: Path, last: int) -> tuple[str, ...]:
    """Return a sentence on a video that breaks off, by the number of the last frame that was kept:
    the sharpest of its part, which ends at most one part later.
    """
    _, _, count = _measure(path)
    if not breaks_off(last + 1 + -(-count // MAX_FRAMES), count):
        return ()
    return (f"{path} breaks off near frame {last} of {count}: copy it again for all of them.",)


def _encode(path: Path, digits: int, progress: Progress) -> Iterator[tuple[str, bytes]]:
    """Yield a name and the bytes of a PNG for each kept frame."""
    for frame in sharpest_frames(path, MAX_FRAMES, progress):
        name = f"{frame.number:0{digits}d}.png"
        yield name, cv2.imencode(".png", frame.pixels, PNG)[1].tobytes()


def sharpest_frames(path: Path, sections: int, progress: Progress) -> Iterator[VideoFrame]:
    """Yield the sharpest frame of each of so many equal parts of a video.

    Raises:
        InputError: the file is no video that can be read.
    """
    _, _, count = _measure(path)
    advance = progress.task(f"Frames of {path.name}", count)
    yield from sharpest_of(_read_frames(path), count, sections, advance)


def sharpest_of(
    frames: Iterable[VideoFrame], count: int, sections: int, advance: Advance
) -> Iterator[VideoFrame]:
    """Yield the sharpest frame of each of so many equal parts of a recording with `count` frames,
    or of as many parts as it has frames.
    """
    sections = min(count, sections)
    best: VideoFrame | None = None
    section = 0
    for frame in frames:
        advance(min(frame.number + 1, count), "")
        if frame.number * sections >= (section + 1) * count and section + 1 < sections:
            section = frame.number * sections // count
            if best:
                yield best
            best = None
        if best is None or frame.sharpness > best.sharpness:
            best = frame
    if best:
        yield best


def _read_frames(path: Path) -> Iterator[VideoFrame]:
    video = open_video(path)
    try:
        number = 0
        while True:
            time_s = video.get(cv2.CAP_PROP_POS_MSEC) / 1000
            success, pixels = video.read()
            if not success:
                return
            picture = np.asarray(pixels, np.uint8)
            yield VideoFrame(number, time_s, picture, measure_sharpness(picture))
            number += 1
    finally:
        video.release()


def measure_sharpness(picture: Picture) -> float:
    """Return the variance of the Laplacian of a BGR or grey picture, which blur lowers."""
    factor = min(1.0, SHARPNESS_SIDE / max(picture.shape))
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY) if picture.ndim == 3 else picture
    if factor < 1:
        grey = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    return float(cv2.Laplacian(grey, cv2.CV_32F).var())
