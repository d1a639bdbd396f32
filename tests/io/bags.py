"""Small recordings of ROS, written by rosbags."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

TOPIC = "/camera/image_raw"
INFO = "/camera/camera_info"
NOTE = "/note"
DEPTHS = "/camera/depth"
FRAME = "camera_optical"
START_NS = 1_700_000_000_000_000_000
INTERVAL_NS = 100_000_000
KINDS = ("bag", "mcap", "folder")
"""The kinds of recordings: a .bag of ROS 1, a .mcap of ROS 2, and a folder with a .db3."""

Pixels = NDArray


@dataclass(frozen=True)
class RawPicture:
    """The content of a message of sensor_msgs/Image."""

    encoding: str
    width: int
    height: int
    step: int
    data: bytes
    big_endian: bool = False


def raw(encoding: str, pixels: Pixels, padding: int = 0, *, big_endian: bool = False) -> RawPicture:
    """Return (H, W) or (H, W, C) pixels as they are, with rows that are longer by `padding` bytes
    of another value.
    """
    order = ">u2" if big_endian else "<u2"
    stored = pixels.astype(order) if pixels.dtype == np.uint16 else pixels
    rows = np.ascontiguousarray(stored).view(np.uint8).reshape(len(pixels), -1)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=77)
    height, width = pixels.shape[:2]
    return RawPicture(encoding, width, height, padded.shape[1], padded.tobytes(), big_endian)


def jpeg(picture: Pixels) -> Mapping[str, object]:
    return {"format": "jpeg", "data": cv2.imencode(".jpg", picture)[1].ravel()}


def png(picture: Pixels) -> Mapping[str, object]:
    return {"format": "bgr8; png compressed bgr8", "data": cv2.imencode(".png", picture)[1].ravel()}


def write_bag(
    path: Path,
    kind: str,
    pictures: Sequence[RawPicture | Mapping[str, object]],
    *,
    topic: str = TOPIC,
    info: bool = True,
    transforms: bool = False,
    depths: Mapping[int, RawPicture | Mapping[str, object]] | None = None,
) -> Path:
    """Write a recording with pictures, notes between them, and a camera_info for each picture, and
    return what a person would name.

    Args:
        path: without a suffix.
        kind: one of KINDS.
        pictures: raw, or the fields of a compressed one.
        topic: of the pictures.
        info: False to leave camera_info out.
        transforms: True for a static transform of something else.
        depths: depth images by their time in ns after the first picture, in order. They are
            recorded 20 ms later.
    """
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    is_ros1 = kind == "bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_ros1 else Stores.ROS2_HUMBLE)
    if is_ros1:
        definition = "geometry_msgs/TransformStamped[] transforms"
        store.register(get_types_from_msg(definition, "tf2_msgs/msg/TFMessage"))
    types = store.types
    serialize = store.serialize_ros1 if is_ros1 else store.serialize_cdr
    plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
    place = path.with_suffix(".bag") if is_ros1 else path
    place.parent.mkdir(parents=True, exist_ok=True)
    writer: Any = Writer1(place) if is_ros1 else Writer(place, version=9, storage_plugin=plugin)
    compressed = isinstance(pictures[0], Mapping)
    image_types = ["sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"]
    with writer:
        names = {topic: image_types[compressed], NOTE: "std_msgs/msg/String"}
        if info:
            names[INFO] = "sensor_msgs/msg/CameraInfo"
        if depths:
            names[DEPTHS] = image_types[isinstance(next(iter(depths.values())), Mapping)]
        if transforms:
            names["/tf_static"] = "tf2_msgs/msg/TFMessage"
        connections = {
            name: writer.add_connection(name, msgtype, typestore=store)
            for name, msgtype in names.items()
        }

        def write(name: str, time_ns: int, *fields: Any) -> None:
            message = types[names[name]](*fields)
            writer.write(connections[name], time_ns, serialize(message, names[name]))

        def header_at(time_ns: int, number: int) -> Any:
            stamp = types["builtin_interfaces/msg/Time"](time_ns // 10**9, time_ns % 10**9)
            sequence = (number,) if is_ros1 else ()
            return types["std_msgs/msg/Header"](*sequence, stamp, FRAME)

        def write_picture(
            name: str, time_ns: int, header: Any, picture: RawPicture | Mapping[str, object]
        ) -> None:
            if not isinstance(picture, RawPicture):
                write(name, time_ns, header, picture["format"], picture["data"])
                return
            data = np.frombuffer(picture.data, np.uint8)
            size = picture.height, picture.width
            endian = int(picture.big_endian)
            fields = (header, *size, picture.encoding, endian, picture.step, data)
            write(name, time_ns, *fields)

        if transforms:
            write("/tf_static", START_NS - 1, [])
        for number, (after_ns, depth) in enumerate((depths or {}).items()):
            time_ns = START_NS + after_ns
            write_picture(DEPTHS, time_ns + 20_000_000, header_at(time_ns, number), depth)
        for number, picture in enumerate(pictures):
            time_ns = START_NS + number * INTERVAL_NS
            header = header_at(time_ns, number)
            delayed_ns = time_ns + 5_000_000  # the recorder's clock, not the camera's
            write_picture(topic, delayed_ns, header, picture)
            if info:
                size = (
                    (picture.height, picture.width) if isinstance(picture, RawPicture) else (4, 4)
                )
                matrix = np.array([500.0, 0, 70, 0, 510, 50, 0, 0, 1])
                rest = (matrix, np.eye(3).ravel(), np.zeros(12), 0, 0)
                region = types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
                lens = "plumb_bob", np.array([0.1, -0.2, 0, 0, 0])
                write(INFO, delayed_ns, header, *size, *lens, *rest, region)
            write(NOTE, delayed_ns + 1, f"note {number}")
    return next(place.glob("*.mcap")) if kind == "mcap" else place


def read_bag(path: Path) -> dict[str, list[tuple[int, bytes, Any]]]:
    """Return the time in ns, the bytes and the message of all messages of each topic."""
    from rosbags.highlevel import AnyReader

    topics: dict[str, list[tuple[int, bytes, Any]]] = {}
    with AnyReader([path]) as reader:
        for connection, time_ns, data in reader.messages():
            message = reader.deserialize(data, connection.msgtype)
            topics.setdefault(connection.topic, []).append((time_ns, bytes(data), message))
    return topics
