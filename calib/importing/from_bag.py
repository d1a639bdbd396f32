"""Import a topic of pictures of a board from a recording of ROS: its sharpest pictures, spread over
its whole length.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np

from calib.corners.detect import eight_bits
from calib.errors import InputError
from calib.importing.from_video import MAX_FRAMES, PNG, VideoFrame, measure_sharpness, sharpest_of
from calib.importing.session_draft import SessionDraft
from calib.io.bag import Bag, open_bag, stamp_s
from calib.io.bag_picture import message_image
from calib.io.images import Image
from calib.io.left_out_pictures import LeftOutPictures
from calib.progress import Progress, Silent
from calib.session.board import Board
from calib.session.camera import Camera

if TYPE_CHECKING:
    from rosbags.interfaces import Connection


@dataclass(frozen=True, slots=True)
class _TopicFrames:
    """The kept pictures of a topic, which are read while the session is written."""

    path: Path
    pictures: Connection
    size: tuple[int, int]
    """Width and height of the pictures, px. Those of another size are left out."""
    left_out: LeftOutPictures
    progress: Progress
    times: dict[str, float] = field(default_factory=dict)

    def __iter__(self) -> Iterator[tuple[str, bytes]]:
        """Yield a name and the bytes of a PNG for each kept picture, and note its time."""
        with open_bag(self.path) as bag:
            topic = self.pictures.topic
            count = bag.reader.topics[topic].msgcount
            advance = self.progress.task(f"Pictures of {topic}", count)
            frames = _read_pictures(bag, self.pictures, self.left_out, self.size)
            for frame in sharpest_of(frames, count, MAX_FRAMES, advance):
                name = f"{frame.number:0{len(str(count))}d}.png"
                self.times[name] = frame.time_s
                yield name, cv2.imencode(".png", frame.pixels, PNG)[1].tobytes()


def from_bag(
    path: Path, board: Board, topic: str | None = None, progress: Progress | None = None
) -> SessionDraft:
    """Import the sharpest picture of each of MAX_FRAMES equal parts of a recording.

    Args:
        path: a .bag of ROS 1, a .mcap or .db3, or the folder of a bag of ROS 2.
        board: the board that the pictures show.
        topic: the topic of the pictures; None: the only one that there is.
        progress: shows how far the reading is.

    Raises:
        InputError: rosbags is not installed, or the recording has no such pictures.
    """
    with open_bag(path) as bag:
        pictures = bag.picture_topic(topic)
        damage = LeftOutPictures()
        first = next(_read_pictures(bag, pictures, damage), None)
        if first is None:
            damage.check(0)
            raise InputError(f"{path} has no picture on {pictures.topic}: choose another topic.")
        info = bag.camera_info(pictures.topic)
    height, width = first.pixels.shape[:2]
    left_out = LeftOutPictures()
    frames = _TopicFrames(path, pictures, (width, height), left_out, progress or Silent())
    return SessionDraft(
        path,
        board,
        Camera(width, height),
        frames=frames,
        times=lambda: frames.times,
        remarks=tuple(_describe_info(info)),
        late_notices=left_out.sentences,
    )


def _read_pictures(
    bag: Bag,
    pictures: Connection,
    left_out: LeftOutPictures,
    size: tuple[int, int] | None = None,
) -> Iterator[VideoFrame]:
    """Yield the pictures of a topic, numbered from 0 on with those that are left out. Their time is
    that of their headers, and where nobody set it, that of the recording.

    Args:
        pictures: a connection of the topic. What others send on it in messages of another type does
            not count.
        left_out: notes what is damaged or of another size.
        size: px, the width and height; None: that of the first picture.
    """
    used = 0
    messages = bag.raw_messages(bag.connections_like(pictures.topic, pictures.msgtype))
    for number, (connection, time_ns, data) in enumerate(messages):
        try:
            message = bag.read_message(connection, data)
            pixels = message_image(message)
            size = size or (pixels.shape[1], pixels.shape[0])
            _check_size(pixels, size)
        except InputError as error:
            left_out.note(InputError(f"{bag.path}, {connection.topic}: {error}"), used)
            continue
        used += 1
        sharpness = measure_sharpness(np.asarray(eight_bits(pixels), np.uint8))
        yield VideoFrame(number, stamp_s(message) or 1e-9 * time_ns, pixels, sharpness)


def _check_size(pixels: Image, size: tuple[int, int]) -> None:
    """Raise InputError for a picture of another width and height, px."""
    height, width = pixels.shape[:2]
    if (width, height) != size:
        raise InputError(
            f"a picture has {width}x{height} px and the first one {size[0]}x{size[1]} px: one"
            " session holds pictures of one size."
        )


def _describe_info(info: Any | None) -> Iterator[str]:
    """Yield lines on the camera_info that came with the pictures, if it has a calibration."""
    matrix = getattr(info, "k", getattr(info, "K", ()))
    distortion = getattr(info, "d", getattr(info, "D", ()))
    if info is None or not any(matrix):
        return
    numbers = ", ".join(f"{name}: {matrix[i]:g}" for name, i in FOCAL_AND_CENTRE)
    coefficients = ", ".join(f"{number:g}" for number in distortion)
    yield f"The camera_info of the recording, {info.width}x{info.height} px, has the lens model"
    yield f"{info.distortion_model}. If it was calibrated without the cover, state it in camera:"
    yield f"  intrinsics: {{{numbers}, distortion: [{coefficients}]}}"


FOCAL_AND_CENTRE = (("fx", 0), ("fy", 4), ("cx", 2), ("cy", 5))
"""The places of the focal lengths and the principal point in a (9,) camera matrix."""
