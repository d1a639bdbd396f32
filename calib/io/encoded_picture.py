"""Pictures, decoded from their bytes. Their size is read from the header first: a file of 2 MB may
hold a picture of 4 GB.
"""

import re
import struct
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.io.arrays import MOST_DECODED

# What OpenCV would print is raised here, as a sentence. Its log moved between versions; 0 is silent
# in all of them.
(cv2.utils.logging.setLogLevel if hasattr(cv2.utils, "logging") else cv2.setLogLevel)(0)  # type: ignore[attr-defined]

JPEG = b"\xff\xd8\xff"
PNG = b"\x89PNG\r\n\x1a\n"
BMP = b"BM"
EXR = b"v/1\x01"
FRAMES = frozenset((*range(0xC0, 0xD0),)) - {0xC4, 0xC8, 0xCC}
"""JPEG's markers of a frame's header, which has the picture's size."""
_JPEG_MARKER = re.compile(rb"\xff([^\x00\xff\xd0-\xd7])")
"""Any but a stuffed 0xff and the restart markers, which stand inside the compressed data.

Of 0xff that are repeated, the last counts.
"""
TIFF_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}
"""The types of whole numbers in a TIFF's directory."""
WIDTH, HEIGHT, BITS, SAMPLES = 256, 257, 258, 277
TILE_WIDTH, TILE_HEIGHT = 322, 323
"""Tags of a TIFF's directory."""


class TooLargeError(ValueError):
    """A picture that takes more memory than MOST_DECODED."""


def decode_picture(data: bytes, flags: int = cv2.IMREAD_UNCHANGED) -> NDArray[Any]:
    """Return the pixels of a PNG, JPEG, BMP, TIFF or OpenEXR file, as OpenCV decodes them.

    Raises:
        TooLargeError: they take more than MOST_DECODED bytes. No memory was taken for them.
        ValueError: it is none of these, or a damaged one.
    """
    kind = next((magic for magic in NEEDED_BYTES if data.startswith(magic)), None)
    if kind is None:
        raise ValueError("not a picture of a known kind")
    try:
        needed = NEEDED_BYTES[kind](data)
    except (struct.error, KeyError, IndexError, OverflowError) as error:
        raise ValueError("the header is damaged") from error
    if needed > MOST_DECODED:
        raise TooLargeError(f"more than {MOST_DECODED >> 30} GB when decoded")
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise ValueError("OpenCV cannot decode it") from error
    if pixels is None:
        raise ValueError("OpenCV cannot decode it")
    return pixels


def jpeg_segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield each segment's marker and where its content begins, a thumbnail's own left out."""
    at = 2
    while match := _JPEG_MARKER.search(data, at):
        yield match[1][0], match.end()
        at = match.end() + int.from_bytes(data[match.end() : match.end() + 2], "big")


def _jpeg_bytes(data: bytes) -> int:
    for marker, begin in jpeg_segments(data):
        if marker in FRAMES:
            bits, height, width, channels = struct.unpack_from(">BHHB", data, begin + 2)
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
    """The header is a list of attributes: name, type, length, content."""
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
    left, top, right, bottom = box
    return (right - left + 1) * (bottom - top + 1) * max(channels, 4) * 4


def _tiff_bytes(data: bytes) -> int:
    """Return the bytes of the file's first picture, or of one of its tiles where that is larger."""
    order = "<" if data.startswith(b"II") else ">"
    large = data[2:4] in (b"+\0", b"\0+")
    count_format, entry_format = ("Q", "HHQ8s") if large else ("H", "HHI4s")
    (begin,) = struct.unpack_from(order + ("Q" if large else "I"), data, 8 if large else 4)
    (count,) = struct.unpack_from(order + count_format, data, begin)
    begin += struct.calcsize(order + count_format)
    entry_size = struct.calcsize(order + entry_format)
    tags = {BITS: 1, SAMPLES: 1, TILE_WIDTH: 0, TILE_HEIGHT: 0}
    for index in range(min(count, 4096)):
        tag, kind, values, content = struct.unpack_from(
            order + entry_format, data, begin + index * entry_size
        )
        if kind in TIFF_TYPES:
            form = order + TIFF_TYPES[kind]
            if values * struct.calcsize(form) > len(content):  # it is elsewhere in the file
                (place,) = struct.unpack(order + ("Q" if large else "I"), content)
                (tags[tag],) = struct.unpack_from(form, data, place)
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
"""How many bytes a picture takes when decoded, by the bytes that its file begins with."""
