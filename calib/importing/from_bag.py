"""Import a topic of pictures of a board from a recording of ROS: its sharpest pictures, spread over
its whole length.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from calib.corners.detect import eight_bits
from calib.errors import InputError
from calib.importing.from_video import MAX_FRAMES, PNG, VideoFrame, measure_sharpness, sharpest_of
from calib.importing.session_draft import SessionDraft
from calib.io.bag import Bag, open_bag, stamp_s
from calib.io.bag_picture import message_image
from calib.progress import Progress, Silent
from calib.session.board import Board
from calib.session.camera import Camera


@dataclass(frozen=True, slots=True)
class _TopicFrames:
    """The kept pictures of a topic, which are read while the session is written."""

    path: Path
    topic: str | None
    progress: Progress
    times: dict[str, float] = field(default_factory=dict)

    def __iter__(self) -> Iterator[tuple[str, bytes]]:
        """Yield a name and the bytes of a PNG for each kept picture, and note its time."""
        with open_bag(self.path) as bag:
            connection = bag.picture_topic(self.topic)
            count = bag.reader.topics[connection.topic].msgcount
            advance = self.progress.task(f"Pictures of {connection.topic}", count)
            frames = _read_pictures(bag, connection)
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
        connection = bag.picture_topic(topic)
        first = next(_read_pictures(bag, connection), None)
        if first is None:
            raise InputError(f"{path} has no picture on {connection.topic}: choose another topic.")
        info = bag.camera_info(connection.topic)
    height, width = first.pixels.shape[:2]
    frames = _TopicFrames(path, connection.topic, progress or Silent())
    return SessionDraft(
        path,
        board,
        Camera(width, height),
        frames=frames,
        times=lambda: frames.times,
        remarks=tuple(_describe_info(info)),
    )


def _read_pictures(bag: Bag, connection: Any) -> Iterator[VideoFrame]:
    """Yield the pictures of a topic. Their time is that of their headers, and where nobody set it,
    that of the recording.
    """
    connections = [c for c in bag.reader.connections if c.topic == connection.topic]
    for number, (time_ns, message) in enumerate(bag.messages(connections)):
        try:
            pixels = message_image(message)
        except InputError as error:
            raise InputError(f"{bag.path}, {connection.topic}: {error}") from error
        sharpness = measure_sharpness(np.asarray(eight_bits(pixels), np.uint8))
        yield VideoFrame(number, stamp_s(message) or 1e-9 * time_ns, pixels, sharpness)


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
