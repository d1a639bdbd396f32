"""Pictures in messages of ROS: sensor_msgs/Image and sensor_msgs/CompressedImage to arrays and
back.
"""

import struct
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError, brief
from calib.io.encoded_picture import TooLargeError, decode_picture
from calib.io.images import Image

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
PICTURE_MESSAGES = (IMAGE, COMPRESSED_IMAGE)


@dataclass(frozen=True, slots=True)
class Encoding:
    """The layout of the pixels that an encoding's name stands for."""

    channels: int = 1
    sixteen_bit: bool = False
    to_image: int | None = None
    """The OpenCV conversion to grey or BGR; None if the pixels are that already."""
    from_image: int | None = None
    """The OpenCV conversion back; None if there is none, or none is needed."""


ENCODINGS: Mapping[str, Encoding] = {
    "mono8": Encoding(),
    "8UC1": Encoding(),
    "mono16": Encoding(sixteen_bit=True),
    "16UC1": Encoding(sixteen_bit=True),
    "bgr8": Encoding(3),
    "8UC3": Encoding(3),
    "rgb8": Encoding(3, False, cv2.COLOR_RGB2BGR, cv2.COLOR_BGR2RGB),
    "bgra8": Encoding(4, False, cv2.COLOR_BGRA2BGR, cv2.COLOR_BGR2BGRA),
    "rgba8": Encoding(4, False, cv2.COLOR_RGBA2BGR, cv2.COLOR_BGR2RGBA),
    "bayer_rggb8": Encoding(1, False, cv2.COLOR_BayerBG2BGR),
    "bayer_bggr8": Encoding(1, False, cv2.COLOR_BayerRG2BGR),
    "bayer_gbrg8": Encoding(1, False, cv2.COLOR_BayerGR2BGR),
    "bayer_grbg8": Encoding(1, False, cv2.COLOR_BayerGB2BGR),
    "yuyv": Encoding(2, False, cv2.COLOR_YUV2BGR_YUYV),
    "yuv422_yuy2": Encoding(2, False, cv2.COLOR_YUV2BGR_YUYV),
    "uyvy": Encoding(2, False, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422": Encoding(2, False, cv2.COLOR_YUV2BGR_UYVY),
}
"""The encodings of sensor_msgs/Image that are read, by their names. OpenCV names a Bayer pattern by
the second row, ROS by the first.
"""
FLOAT_DEPTHS = "32FC1"
"""The encoding of depths in metres."""
MILLIMETRES = ("16UC1", "mono16")
"""The encodings of depths in millimetres."""
JPEG = [cv2.IMWRITE_JPEG_QUALITY, 97]


def message_image(message: Any) -> Image:
    """Return the (H, W) grey or (H, W, 3) BGR pixels of a message, uint8 or uint16.

    Raises:
        InputError: the message is damaged, or its encoding is not read.
    """
    if not hasattr(message, "encoding"):
        return _decompressed(message)
    encoding = ENCODINGS.get(message.encoding)
    if encoding is None:
        raise InputError(
            f"the pictures have the encoding {brief(repr(message.encoding))}: convert them to one"
            f" of {', '.join(ENCODINGS)}."
        )
    itemsize = 2 if encoding.sixteen_bit else 1
    row_bytes = message.width * encoding.channels * itemsize
    step = max(int(message.step), row_bytes)
    data = np.asarray(message.data, np.uint8)
    if not row_bytes or not message.height or data.size < step * (message.height - 1) + row_bytes:
        raise InputError(
            f"a picture of {message.width}x{message.height} px has only {data.size} bytes: record"
            " the bag again."
        )
    padded = np.zeros(step * message.height, np.uint8)
    count = min(data.size, padded.size)
    padded[:count] = data[:count]
    rows = np.ascontiguousarray(padded.reshape(message.height, step)[:, :row_bytes])
    pixels: Any = rows
    if encoding.sixteen_bit:
        pixels = rows.view(">u2" if message.is_bigendian else "<u2").astype(np.uint16)
    if encoding.channels > 1:
        pixels = rows.reshape(message.height, message.width, encoding.channels)
    if encoding.to_image is not None:
        pixels = np.asarray(cv2.cvtColor(pixels, encoding.to_image), np.uint8)
    return pixels  # type: ignore[no-any-return]


def with_image(message: Any, image: Image) -> Any:
    """Return the message with other pixels, in its own encoding where that can be written: a Bayer
    pattern and YUV become bgr8. A compressed message stays of its kind, PNG or JPEG.

    Args:
        message: a message that `message_image` reads.
        image: (h, w) or (h, w, 3) BGR, of the type that `message_image` returned.
    """
    if not hasattr(message, "encoding"):
        is_png = "png" in message.format.lower()
        suffix, options = (".png", []) if is_png else (".jpg", JPEG)
        encoded = cv2.imencode(suffix, image, options)[1].ravel()
        return replace(message, data=np.asarray(encoded, np.uint8))
    encoding = ENCODINGS[message.encoding]
    name = message.encoding
    if encoding.from_image is not None:
        image = np.asarray(cv2.cvtColor(image, encoding.from_image), np.uint8)
    elif encoding.to_image is not None:
        name = "bgr8"
    image = np.ascontiguousarray(image.astype(image.dtype.newbyteorder("<"), copy=False))
    return replace(
        message,
        encoding=name,
        height=image.shape[0],
        width=image.shape[1],
        step=image.strides[0],
        is_bigendian=type(message.is_bigendian)(0),
        data=image.view(np.uint8).ravel(),
    )


def message_depths(message: Any) -> NDArray[np.float32]:
    """Return the (H, W) m depths of a message, 0 where unknown: floating-point metres or 16-bit
    millimetres, raw, as a PNG, or by image_transport's compressedDepth.

    Raises:
        InputError: the message is damaged, or holds no depths.
    """
    if not hasattr(message, "encoding"):
        return _decompressed_depths(message)
    if message.encoding == FLOAT_DEPTHS:
        pixels = _float_pixels(message)
    elif message.encoding in MILLIMETRES:
        pixels = np.asarray(message_image(message) / 1000, np.float32)
    else:
        raise InputError(
            f"the depths have the encoding {brief(repr(message.encoding))}: ROS has 16UC1 for"
            " millimetres and 32FC1 for metres."
        )
    return np.where(np.isfinite(pixels), pixels, np.float32(0))


def _float_pixels(message: Any) -> NDArray[np.float32]:
    as_bytes = replace(message, encoding="8UC1", width=4 * message.width)
    kind = ">f4" if message.is_bigendian else "<f4"
    pixels: NDArray[np.float32] = message_image(as_bytes).view(kind).astype(np.float32)
    return pixels


def _decompressed_depths(message: Any) -> NDArray[np.float32]:
    """Return the depths of a compressed message.

    Source: compressed_depth_image_transport, codec.cpp: 12 bytes in front of the PNG hold a number
    and two parameters; with those, pixels of floating-point depths are inverse depths.
    """
    data = np.asarray(message.data, np.uint8).tobytes()
    has_header = "compressedDepth" in message.format
    stored = _decompressed(replace(message, data=np.frombuffer(data[12 * has_header :], np.uint8)))
    if stored.ndim != 2 or stored.dtype != np.uint16:
        raise InputError(
            f"the depths have the format {brief(repr(message.format))}: a PNG of 16 bits is read;"
            " convert the topic by image_transport republish."
        )
    if not has_header or FLOAT_DEPTHS not in message.format:
        return np.asarray(stored / 1000, np.float32)
    factor, offset = struct.unpack("<ff", data[4:12])
    distance = np.where(stored > 0, stored - offset, np.inf)
    depths = np.divide(factor, distance, out=np.zeros(stored.shape), where=distance > 0)
    return np.asarray(depths, np.float32)


def _decompressed(message: Any) -> Image:
    try:
        pixels = decode_picture(np.asarray(message.data, np.uint8).tobytes())
    except (ValueError, TooLargeError) as error:
        raise InputError(
            f"a picture of the format {brief(repr(message.format))} cannot be decoded: JPEG and PNG"
            " can; convert the topic by image_transport republish."
        ) from error
    return pixels[..., :3] if pixels.ndim == 3 else pixels
