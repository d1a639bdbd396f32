"""Straighten the pictures of a recording of ROS, and describe the camera that would have taken
them.

The recording is copied. The pictures of one topic become straight, its camera_info becomes that of
a pinhole without distortion, and every other message is the same, byte for byte.

With a depth for each pixel, a straight picture is that of a pinhole at the calibration's origin. At
one depth Z, a straight picture is that of a pinhole at the calibration's origin with the camera
matrix K. It is as well the picture of a pinhole at any other centre c, whose focal lengths are f (Z
- c_z) / Z and whose principal point is moved by f c_x / Z and f c_y / Z. The camera_info is that of
the centre which the covered camera's rays come nearest to meeting in, because it errs least for
what lies nearer or farther. A static transform says where that centre is.
"""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from calib.apply.undistorter import Undistorter
from calib.errors import InputError
from calib.export.sampled_rays import FIT_GRID, SampledRays
from calib.io.bag import CAMERA_INFO, Bag, open_bag
from calib.io.bag_picture import message_image, with_image
from calib.io.depth_topic import DepthTopic
from calib.io.files import make_folder
from calib.io.left_out_pictures import LeftOutPictures
from calib.io.output_folder import OutputFolder
from calib.progress import Progress

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

Array = NDArray[np.float64]

TRANSFORMS = "tf2_msgs/msg/TFMessage"
TRANSFORMS_OF_ROS1 = "geometry_msgs/TransformStamped[] transforms"
STATIC = "/tf_static"
NO_DIGEST = f"RIHS01_{64 * '0'}"
"""The hash of a type that nobody knows: recordings of ROS 2 before Iron hold no definitions, so the
types of a person's own packages are copied without one.
"""
SUFFIX_OF_FRAME = "_straight"
"""The straight camera's frame is the pictures' frame with this at its end."""


@dataclass(frozen=True, slots=True, eq=False)
class StraightCamera:
    """The pinhole that takes a straight picture."""

    matrix: Array
    """(3, 3) camera matrix, px."""
    centre: Array
    """(3,) m, in the calibration's camera frame, whose axes are also its own."""
    size: tuple[int, int]
    """Width and height, px."""


@dataclass(frozen=True, slots=True)
class StraightBag:
    """A written recording of straight pictures."""

    path: Path
    left_out: Sequence[str]
    """A sentence if pictures are left out, because they are damaged or of another size."""
    black: int
    """The number of pictures without any depth, which are black."""
    largest_gap_s: float
    """The longest time between a picture and the depth image that was taken for it."""


def straight_camera(undistorter: Undistorter) -> StraightCamera:
    """Return the pinhole whose picture an undistorter makes."""
    calibration = undistorter.calibration
    path, _ = calibration.model()
    centre = np.zeros(3)
    if isinstance(undistorter.depth, np.ndarray):
        return StraightCamera(undistorter.camera_matrix, centre, undistorter.size)
    if not path.central:
        centre = SampledRays.sample(calibration, FIT_GRID).nearly_intersect()
    nearness = 1 / float(undistorter.depth)  # one depth, maybe infinite
    matrix = undistorter.camera_matrix
    matrix[:2, 2] += matrix[[0, 1], [0, 1]] * centre[:2] * nearness
    matrix[[0, 1], [0, 1]] *= 1 - centre[2] * nearness
    return StraightCamera(matrix, centre, undistorter.size)


def straighten_bag(
    path: Path,
    topic: str | None,
    undistorter: Undistorter,
    output: OutputFolder,
    name: str,
    progress: Progress,
    depth_topic: str | None = None,
) -> StraightBag:
    """Write the recording with straight pictures.

    Args:
        path: a .bag of ROS 1, or a recording of ROS 2.
        topic: the topic of the pictures; None: the only one that there is.
        undistorter: for one depth; with a depth topic, for an image of unknown depths.
        output: the folder of the result.
        name: its file name: .bag for ROS 1, .mcap for ROS 2.
        progress: shows how far the work is.
        depth_topic: the topic with the depths of the straight pictures' pixels; None: the depth is
            the undistorter's.

    Raises:
        InputError: a recording cannot be read or written, or none of its pictures can be used.
    """
    camera = straight_camera(undistorter)
    with open_bag(path) as bag:
        suffix = ".bag" if bag.is_ros1 else ".mcap"
        if Path(name).suffix != suffix:
            raise InputError(
                f"{name} does not say what is written: a recording of ROS"
                f" {1 if bag.is_ros1 else 2} becomes a {suffix}, such as -o straight{suffix}."
            )
        if depth_topic and topic == depth_topic:
            raise InputError(f"--topic and --depth-topic both name {topic}: they are two topics.")
        pictures = bag.picture_topic(topic, depth_topic)
        depths = DepthTopic(bag, depth_topic) if depth_topic else None
        make_folder(output.path)
        temporary = output.path / f".refracal-{secrets.token_hex(8)}{suffix}"
        try:
            with _writer(bag, temporary) as writer:
                straightener = _Straightener(undistorter, depths)
                left_out = _copy(bag, pictures, straightener, camera, writer, progress)
            made = temporary if bag.is_ros1 else next(temporary.glob("*.mcap"))
            return StraightBag(
                path=output.take(made, name),
                left_out=left_out.sentences(),
                black=straightener.black,
                largest_gap_s=depths.largest_gap_s if depths else 0.0,
            )
        except OSError as error:
            raise InputError(
                f"{output.path / name} cannot be written ({error.strerror}): choose another place"
                " with -o."
            ) from error
        finally:
            if temporary.is_dir():
                shutil.rmtree(temporary, ignore_errors=True)
            temporary.unlink(missing_ok=True)


def _copy(
    bag: Bag,
    pictures: Connection,
    straightener: _Straightener,
    camera: StraightCamera,
    writer: _Writer,
    progress: Progress,
) -> LeftOutPictures:
    """Write all messages, and return what is known of pictures that are left out."""
    info_topic = bag.camera_info_topic(pictures.topic)
    has_info = any(c.topic == info_topic for c in bag.reader.connections)
    advance = progress.task(pictures.topic, bag.reader.topics[pictures.topic].msgcount)
    left_out = LeftOutPictures()
    done = 0
    for connection, time_ns, data in bag.raw_messages():
        if (connection.topic, connection.msgtype) == (pictures.topic, pictures.msgtype):
            try:
                message = bag.read_message(connection, data)
                straight = straightener.straighten(time_ns, message)
            except InputError as error:
                place = f"{bag.path}, {connection.topic}"
                left_out.note(InputError(f"{place}: {error}"), done)
                continue
            if not done:
                transform = writer.transform(message.header, camera)
                writer.write_message(STATIC, TRANSFORMS, time_ns, transform)
            writer.write_message(connection.topic, connection.msgtype, time_ns, straight)
            if not has_info:
                info = writer.camera_info(straight.header, camera)
                writer.write_message(info_topic, CAMERA_INFO, time_ns, info)
            done += 1
            advance(done, "")
            continue
        with suppress(InputError):  # a damaged camera_info is copied as it is
            if connection.topic == info_topic and connection.msgtype == CAMERA_INFO:
                header = _moved(bag.read_message(connection, data).header)
                info = writer.camera_info(header, camera)
                writer.write_message(info_topic, CAMERA_INFO, time_ns, info)
                continue
        writer.write_raw(connection, time_ns, data)
    left_out.check(done)
    if not done:
        raise InputError(f"{bag.path} has no picture on {pictures.topic}: choose another topic.")
    return left_out


class _Straightener:
    """Straightens the pictures of a topic, each at its depth."""

    def __init__(self, undistorter: Undistorter, depths: DepthTopic | None) -> None:
        self._undistorter = undistorter
        self._depths = depths
        self.black = 0
        """The number of pictures without any depth."""
        self._number = -1  # of the depth image that the undistorter has

    def straighten(self, time_ns: int, message: Any) -> Any:
        """Return the message with a straight picture; InputError if it has another size, or cannot
        be read.
        """
        self._take_depths(time_ns, message)
        straight = self._undistorter.undistort(message_image(message))
        self.black += self._depths is not None and not self._undistorter.valid.any()
        return replace(
            with_image(message, straight),  # type: ignore[arg-type]  # uint8 or uint16, as it was
            header=_moved(message.header),
        )

    def _take_depths(self, time_ns: int, message: Any) -> None:
        if self._depths is None:
            return
        number, depths = self._depths.nearest(time_ns, message)
        if number == self._number:
            return
        width, height = self._undistorter.size
        if depths.shape != (height, width):
            raise InputError(
                f"{self._depths.topic} has depth images of {depths.shape[1]}x{depths.shape[0]} px,"
                f" and the straight pictures have {width}x{height} px: choose a topic with a depth"
                " for each of their pixels."
            )
        self._undistorter = self._undistorter.at(depths)
        self._number = number


def _moved(header: Any) -> Any:
    """Return the header of a message in the straight camera's frame."""
    return replace(header, frame_id=header.frame_id + SUFFIX_OF_FRAME)


class _Writer:
    """A recording that is written, in the version of ROS of the one that is read."""

    def __init__(self, bag: Bag, writer: Any) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self._bag = bag
        self._writer = writer
        self._store = get_typestore(Stores.ROS1_NOETIC if bag.is_ros1 else Stores.LATEST)
        if TRANSFORMS not in self._store.types:  # rosbags has no tf2_msgs of ROS 1
            self._store.register(get_types_from_msg(TRANSFORMS_OF_ROS1, TRANSFORMS))
        self._connections: dict[tuple[object, ...], Any] = {}

    def write_raw(self, connection: Connection, time_ns: int, data: bytes) -> None:
        self._writer.write(self._copy_of(connection), time_ns, data)

    def write_message(self, topic: str, kind: str, time_ns: int, message: Any) -> None:
        """Write a message into the topic's connection of the recording, or into a new one."""
        present = [
            c for c in self._bag.reader.connections if c.topic == topic and c.msgtype == kind
        ]
        connection = self._copy_of(present[0]) if present else self._new(topic, kind)
        store = self._bag.reader.typestore if present else self._store
        serialize = store.serialize_ros1 if self._bag.is_ros1 else store.serialize_cdr
        self._writer.write(connection, time_ns, serialize(message, kind))

    def camera_info(self, header: Any, camera: StraightCamera) -> Any:
        """Return the message for the straight camera."""
        types = self._store.types
        matrix = camera.matrix
        names = "DKRP" if self._bag.is_ros1 else "dkrp"
        numbers = (np.zeros(5), matrix.ravel(), np.eye(3).ravel())
        values = (*numbers, np.column_stack([matrix, np.zeros(3)]).ravel())
        return types[CAMERA_INFO](
            header=header,
            height=camera.size[1],
            width=camera.size[0],
            distortion_model="plumb_bob",
            binning_x=0,
            binning_y=0,
            roi=types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, do_rectify=False),
            **dict(zip(names, values, strict=True)),
        )

    def transform(self, header: Any, camera: StraightCamera) -> Any:
        """Return the message that says where the straight camera is, in the frame of a picture."""
        types = self._store.types
        x, y, z = camera.centre.tolist()
        return types[TRANSFORMS](
            transforms=[
                types["geometry_msgs/msg/TransformStamped"](
                    header=header,
                    child_frame_id=header.frame_id + SUFFIX_OF_FRAME,
                    transform=types["geometry_msgs/msg/Transform"](
                        translation=types["geometry_msgs/msg/Vector3"](x, y, z),
                        rotation=types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
                    ),
                )
            ]
        )

    def _copy_of(self, connection: Connection) -> Any:
        """Return the written connection for one that is read. Several of a topic become one."""
        ext: Any = connection.ext
        key = connection.topic, connection.msgtype
        if key not in self._connections:
            definition = connection.msgdef.data or None
            digest = connection.digest or None
            if not definition and connection.msgtype not in self._bag.reader.typestore.types:
                definition, digest = "", NO_DIGEST
            known = {
                "typestore": self._bag.reader.typestore,
                "msgdef": definition,
                "md5sum" if self._bag.is_ros1 else "rihs01": digest,
            }
            options = (
                {"callerid": ext.callerid, "latching": ext.latching}
                if self._bag.is_ros1
                else {
                    "serialization_format": ext.serialization_format,
                    "offered_qos_profiles": ext.offered_qos_profiles,
                }
            )
            self._connections[key] = self._writer.add_connection(*key, **known, **options)
        return self._connections[key]

    def _new(self, topic: str, kind: str) -> Any:
        key = topic, kind
        if key not in self._connections:
            options: dict[str, Any] = {"typestore": self._store}
            if topic == STATIC:  # whoever comes later gets it as well
                options |= {"latching": 1} if self._bag.is_ros1 else _latched()
            self._connections[key] = self._writer.add_connection(topic, kind, **options)
        return self._connections[key]


def _latched() -> dict[str, Any]:
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )

    forever = QosTime(2147483647, 4294967295)
    return {
        "offered_qos_profiles": [
            Qos(
                QosHistory.KEEP_LAST,
                1,
                QosReliability.RELIABLE,
                QosDurability.TRANSIENT_LOCAL,
                forever,
                forever,
                QosLiveliness.AUTOMATIC,
                forever,
                avoid_ros_namespace_conventions=False,
            )
        ]
    }


@contextmanager
def _writer(bag: Bag, path: Path) -> Iterator[_Writer]:
    if bag.is_ros1:
        from rosbags.rosbag1 import Writer as Writer1

        with Writer1(path) as writer1:
            yield _Writer(bag, writer1)
        return
    from rosbags.rosbag2 import StoragePlugin, Writer

    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        yield _Writer(bag, writer)
