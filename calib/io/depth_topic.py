"""The depth images of a recording of ROS, by the time of the picture that they belong to."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError, brief
from calib.io.bag import Bag, stamp_s
from calib.io.bag_picture import PICTURE_MESSAGES, message_depths

if TYPE_CHECKING:
    pass

LARGEST_GAP_S = 0.1
"""A picture and its depths may be this far apart before a remark says so: a slow depth camera sends
ten images a second.
"""


class DepthTopic:
    """A topic of depth images, of which one is in memory at a time.

    The time of an image is that of its header, as for the pictures. A program that computes depths
    sends them later than the pictures, so the time of recording would be wrong.
    """

    def __init__(self, bag: Bag, topic: str) -> None:
        """Read the times of all images.

        Raises:
            InputError: the recording is damaged, or has no depth images on the topic.
        """
        self._bag = bag
        self._connections = bag.connections_like(topic, *PICTURE_MESSAGES)
        self.topic = topic
        self.largest_gap_s = 0.0
        """The longest time between a picture and its depth image."""
        times = [_time_s(time_ns, message) for time_ns, message in bag.messages(self._connections)]
        if not times:
            raise InputError(
                f"{bag.path} has no depth images on {brief(topic)}: choose another --depth-topic."
            )
        self._times_s = np.array(times)
        self._index = len(times)
        self._messages: Iterator[tuple[int, Any]] = iter(())
        self._depths = np.zeros((0, 0), np.float32)

    def nearest(self, time_ns: int, message: Any) -> tuple[int, NDArray[np.float32]]:
        """Return the number of the depth image that is nearest in time to a picture, and its
        (height, width) m, 0 where unknown.

        Args:
            time_ns: when the picture was recorded, which counts if its header has no time.
            message: the picture's.

        Raises:
            InputError: the depth image is damaged, or of an encoding that is not read.
        """
        gaps_s = np.abs(self._times_s - _time_s(time_ns, message))
        wanted = int(gaps_s.argmin())
        self.largest_gap_s = max(self.largest_gap_s, float(gaps_s[wanted]))
        if wanted != self._index:
            self._depths = self._read(wanted)
        return wanted, self._depths

    def _read(self, wanted: int) -> NDArray[np.float32]:
        if wanted <= self._index:  # from the start again: this is the first, or time went back
            self._messages = self._bag.messages(self._connections)
            self._index = -1
        for _ in range(wanted - self._index):
            _, message = next(self._messages)
        self._index = wanted
        try:
            return message_depths(message)
        except InputError as error:
            raise InputError(f"on {self.topic}, {error}") from error


def _time_s(time_ns: int, message: Any) -> float:
    return stamp_s(message) or 1e-9 * time_ns
