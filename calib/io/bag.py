"""Recordings of ROS: bags of ROS 1 (.bag), folders and files of ROS 2 (.db3, .mcap), by rosbags.

rosbags is an extra, and is imported when a bag is opened.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calib.errors import InputError, brief
from calib.extras import how_to_install
from calib.io.bag_picture import PICTURE_MESSAGES
from calib.io.files import reading

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.interfaces import Connection

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
MAX_TOPICS = 8
"""The number of topics that a message names."""


@dataclass(frozen=True, slots=True)
class Bag:
    """A recording that is open."""

    path: Path
    reader: AnyReader

    @property
    def is_ros1(self) -> bool:
        return not self.reader.is2

    def picture_topic(self, topic: str | None, depth_topic: str | None = None) -> Connection:
        """Return the connection of a topic of pictures.

        Args:
            topic: its name; None: the only one that there is.
            depth_topic: a topic whose pictures are depths, which is not meant.

        Raises:
            InputError: there is no such topic, or several and none is named.
        """
        pictures = [
            connection
            for connection in self.reader.connections
            if connection.msgtype in PICTURE_MESSAGES and connection.topic != depth_topic
        ]
        names = sorted({connection.topic for connection in pictures})
        listed = ", ".join(map(brief, names[:MAX_TOPICS]))
        if not names:
            other = f" beside the depths of {brief(depth_topic)}" if depth_topic else ""
            raise InputError(
                f"{self.path} has no topic of pictures{other}: give another recording."
            )
        if topic is None and len(names) > 1:
            raise InputError(
                f"{self.path} has several topics of pictures: choose one with --topic, of {listed}."
            )
        for connection in pictures:
            if topic in (None, connection.topic):
                return connection
        raise InputError(
            f"{self.path} has no pictures on {brief(topic)}: choose one with --topic, of {listed}."
        )

    def camera_info_topic(self, topic: str) -> str:
        """Return the name of the camera_info that belongs to a topic of pictures, which need not be
        in the bag: it stands beside it.
        """
        base = topic.removesuffix("/compressed")
        return f"{base.rpartition('/')[0]}/camera_info"

    def camera_info(self, topic: str) -> Any | None:
        """Return the first camera_info that belongs to a topic of pictures; None without one."""
        connections = self.connections_like(self.camera_info_topic(topic), CAMERA_INFO)
        return next((message for _, message in self.messages(connections)), None)

    def connections_like(self, topic: str, *kinds: str) -> Sequence[Connection]:
        """Return the connections of a topic with messages of one of these types."""
        return [c for c in self.reader.connections if c.topic == topic and c.msgtype in kinds]

    def messages(self, connections: Sequence[Connection]) -> Iterator[tuple[int, Any]]:
        """Yield the time in ns at which each message was recorded, and the message. Damaged
        messages are left out; InputError if the recording is damaged.
        """
        if not connections:
            return
        for connection, time_ns, data in self.raw_messages(connections):
            message = None
            with suppress(InputError):
                message = self.read_message(connection, data)
            if message is not None:
                yield time_ns, message

    def raw_messages(
        self, connections: Sequence[Connection] = ()
    ) -> Iterator[tuple[Connection, int, bytes]]:
        """Yield the connection, the time in ns and the bytes of each message, in the order of time.

        Args:
            connections: those to read; none stands for all.

        Raises:
            InputError: the recording is damaged.
        """
        iterator = self.reader.messages(connections)
        while True:
            with _reported_damage(self.path):
                entry = next(iterator, None)
            if entry is None:
                return
            yield entry

    def read_message(self, connection: Connection, data: bytes) -> Any:
        """Return the message that the bytes stand for; InputError if it is damaged."""
        try:
            return self.reader.deserialize(data, connection.msgtype)
        except Exception as error:  # rosbags raises errors of many kinds
            raise InputError(f"a message is damaged ({brief(error)}): record it again.") from error


@contextmanager
def open_bag(path: Path) -> Iterator[Bag]:
    """Open a recording for the `with`; InputError if rosbags is missing, or the recording is
    damaged.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise InputError(f"Bags need one more package: {how_to_install('bags')}") from error
    with reading(path):
        if not path.exists():
            raise InputError(f"{path} is not there: give a .bag, a .mcap or the folder of a bag.")
    with _reported_damage(path):
        reader = AnyReader([path], default_typestore=get_typestore(Stores.LATEST))
        reader.open()
    try:
        yield Bag(path, reader)
    finally:
        reader.close()


@contextmanager
def _reported_damage(path: Path) -> Iterator[None]:
    """Turn what rosbags raises for a damaged recording, errors of many kinds, into InputError."""
    try:
        yield
    except Exception as error:
        raise InputError(
            f"{path} is no recording of ROS, or a damaged one ({brief(error)}): copy it again, or"
            " repair it by ros2 bag reindex, rosbag reindex or mcap recover."
        ) from error


def stamp_s(message: Any) -> float:
    """Return the time in s that stands in a message's header; 0 where nobody set it."""
    stamp = message.header.stamp
    return float(stamp.sec) + 1e-9 * float(stamp.nanosec)
