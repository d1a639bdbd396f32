"""Decode pictures from their bytes. The size is read from the header first, because a file of 2 MB
may hold a picture of 4 GB.
"""

import re
import struct
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.io.arrays import MAX_DECODED_BYTES

# This module raises errors as sentences, so OpenCV's log is switched off. Its function moved
# between versions; level 0 is silent in all of them.
_logging = cv2.utils.logging if hasattr(cv2.utils, "logging") else cv2
_logging.setLogLevel(0)

JPEG = b"\xff\xd8\xff"
PNG = b"\x89PNG\r\n\x1a\n"
BMP = b"BM"
EXR = b"v/1\x01"
FRAME_MARKERS = frozenset((*range(0xC0, 0xD0),)) - {0xC4, 0xC8, 0xCC}
"""The JPEG markers of a frame header, which holds the picture's size."""
_JPEG_MARKER = re.compile(rb"\xff([^\x00\xff\xd0-\xd7])")
"""Any marker except a stuffed 0xff and the restart markers, which are part of the compressed data.

If 0xff is repeated, the last one counts.
"""
TIFF_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}
"""The types of whole numbers in a TIFF's directory, and their codes for `struct`."""
WIDTH, HEIGHT, BITS, SAMPLES = 256, 257, 258, 277
TILE_WIDTH, TILE_HEIGHT = 322, 323
"""Tags of a TIFF's directory."""


class TooLargeError(ValueError):
    """The error of a picture that takes more than MAX_DECODED_BYTES."""


def decode_picture(data: bytes, flags: int = cv2.IMREAD_UNCHANGED) -> NDArray[Any]:
    """Return the pixels of a PNG, JPEG, BMP, TIFF or OpenEXR file, as OpenCV decodes them.

    Raises:
        TooLargeError: the pixels take more than MAX_DECODED_BYTES. No memory was allocated for
        them. ValueError: the file is of another type, or damaged.
    """
    kind = next((magic for magic in NEEDED_BYTES if data.startswith(magic)), None)
    if kind is None:
        raise ValueError("not a picture of a known kind")
    try:
        needed = NEEDED_BYTES[kind](data)
    except (struct.error, KeyError, IndexError, OverflowError) as error:
        raise ValueError("the header is damaged") from error
    if needed > MAX_DECODED_BYTES:
        raise TooLargeError(f"more than {MAX_DECODED_BYTES >> 30} GB when decoded")
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise ValueError("OpenCV cannot decode it") from error
    if pixels is None:
        raise ValueError("OpenCV cannot decode it")
    return pixels


def jpeg_segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield each segment's marker and the offset of its content. A thumbnail's segments are
    skipped.
    """
    at = 2
    while match := _JPEG_MARKER.search(data, at):
        yield match[1][0], match.end()
        at = match.end() + int.from_bytes(data[match.end() : match.end() + 2], "big")


def _jpeg_bytes(data: bytes) -> int:
    for marker, content_start in jpeg_segments(data):
        if marker in FRAME_MARKERS:
            bits, height, width, channels = struct.unpack_from(">BHHB", data, content_start + 2)
            return int(height * width * channels * _whole_bytes(bits))
    raise ValueError("a JPEG without a frame")


def _png_bytes(data: bytes) -> int:
    width, height, bits, colour = struct.unpack_from(">IIBB", data, 16)
    channels = {0: 1, 2: 3, 3: 4, 4: 4, 6: 4}[colour]
    return int(width * height * channels * _whole_bytes(bits))


def _bmp_bytes(data: bytes) -> int:
    (header,) = struct.unpack_from("<I", data, 14)
    width, height, _, bits = struct.unpack_from("<HHHH" if header == 12 else "<iiHH", data, 18)
    return int(abs(width) * abs(height) * (4 if bits == 32 else 3))


def _exr_bytes(data: bytes) -> int:
    """Return the bytes of the decoded picture. The header is a list of attributes: name, type,
    length, content.
    """
    at, channels, box = 8, 0, (0, 0, 0, 0)
    while data[at]:
        name, kind = data[at : at + 512].split(b"\0")[:2]
        at += len(name) + len(kind) + 2
        (length,) = struct.unpack_from("<I", data, at)
        content = data[at + 4 : at + 4 + length]
        at += 4 + length
        if name == b"channels":
            channels = max(1, len(content) // 18)  # at least a name, two ends, and 16 bytes
        elif name == b"dataWindow":
            box = struct.unpack("<4i", content)
    x_min, y_min, x_max, y_max = box
    return (x_max - x_min + 1) * (y_max - y_min + 1) * max(channels, 4) * 4


def _tiff_bytes(data: bytes) -> int:
    """Return the bytes of the file's first picture, or of one tile of it if a tile is larger."""
    order = "<" if data.startswith(b"II") else ">"
    large = data[2:4] in (b"+\0", b"\0+")
    count_format, entry_format = ("Q", "HHQ8s") if large else ("H", "HHI4s")
    (offset,) = struct.unpack_from(order + ("Q" if large else "I"), data, 8 if large else 4)
    (count,) = struct.unpack_from(order + count_format, data, offset)
    offset += struct.calcsize(order + count_format)
    entry_size = struct.calcsize(order + entry_format)
    tags = {BITS: 1, SAMPLES: 1, TILE_WIDTH: 0, TILE_HEIGHT: 0}
    for index in range(min(count, 4096)):
        tag, kind, values, content = struct.unpack_from(
            order + entry_format, data, offset + index * entry_size
        )
        if kind in TIFF_TYPES:
            form = order + TIFF_TYPES[kind]
            if values * struct.calcsize(form) > len(
                content
            ):  # the content is the offset of the value
                (value_offset,) = struct.unpack(order + ("Q" if large else "I"), content)
                (tags[tag],) = struct.unpack_from(form, data, value_offset)
            else:
                (tags[tag],) = struct.unpack_from(form, content)
    width, height = tags[WIDTH], tags[HEIGHT]
    tile = tags[TILE_WIDTH] * tags[TILE_HEIGHT]
    channels = max(tags[SAMPLES], 3 if tags[BITS] <= 8 else 1)  # a palette becomes colours
    return int(max(width * height, tile) * channels * _whole_bytes(tags[BITS]))


def _whole_bytes(bits: int) -> int:
    return max(1, -(-bits // 8))


NEEDED_BYTES: Mapping[bytes, Callable[[bytes], int]] = {
    JPEG: _jpeg_bytes,
    PNG: _png_bytes,
    BMP: _bmp_bytes,
    EXR: _exr_bytes,
    b"II*\0": _tiff_bytes,
    b"MM\0*": _tiff_bytes,
    b"II+\0": _tiff_bytes,
    b"MM\0+": _tiff_bytes,
}
"""For the first bytes of each type of file, the function that returns the bytes of the decoded
picture.
"""
