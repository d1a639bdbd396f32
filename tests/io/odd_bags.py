"""Recordings as other programs leave them: types without definitions, two types on one topic, and
messages that are cut.
"""

import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tests.io.bags import FRAME, START_NS, TOPIC, raw

KIND = "my_msgs/msg/Level"
"""A type of a person's own package."""
LEVELS = "/level"
COUNT = 3


def write_odd_bag(
    path: Path,
    picture: NDArray[np.uint8],
    *,
    level_topic: str = LEVELS,
    cut: bool = False,
    definitions: bool = True,
) -> Path:
    """Write a folder of ROS 2 with COUNT pictures and as many messages of KIND.

    Args:
        picture: (H, W, 3) BGR, in all messages.
        level_topic: of the messages of KIND.
        cut: True to cut the second picture's message.
        definitions: False for a recording from before Iron, which has none.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg("int32 level", KIND))
    types: Any = store.types
    content = raw("bgr8", picture)
    with Writer(path, version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        kind = "sensor_msgs/msg/Image"
        pictures = writer.add_connection(TOPIC, kind, typestore=store)
        levels = writer.add_connection(level_topic, KIND, typestore=store)
        for number in range(COUNT):
            stamp = types["builtin_interfaces/msg/Time"](START_NS // 10**9 + number, 0)
            header = types["std_msgs/msg/Header"](stamp, FRAME)
            size = content.height, content.width
            data = np.frombuffer(content.data, np.uint8)
            message = types[kind](header, *size, "bgr8", 0, content.step, data)
            written = bytes(store.serialize_cdr(message, kind))
            time_ns = START_NS + 10**9 * number
            writer.write(pictures, time_ns, written[:30] if cut and number == 1 else written)
            writer.write(levels, time_ns + 1, store.serialize_cdr(types[KIND](number), KIND))
    if not definitions:
        database = sqlite3.connect(next(path.glob("*.db3")))
        with database:
            database.execute("DELETE FROM message_definitions")
        database.close()
    return path
