"""Decode pictures from their bytes. The size is read from the header first, because a file of 2 MB
may hold a picture of 4 GB.
"""

import re
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
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
WEBP = b"RIFF"
PNM = (b"P5", b"P6")
"""Grey and coloured pixels of a portable anymap, in bytes."""
PNM_TEXT = (b"P2", b"P3")
"""The same in decimal numbers."""
TIFF = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
"""Both orders of bytes, with offsets of 32 and of 64 bits."""
FRAME_MARKERS = frozenset((*range(0xC0, 0xD0),)) - {0xC4, 0xC8, 0xCC}
"""The JPEG markers of a frame header, which holds the picture's size."""
_JPEG_MARKER = re.compile(rb"\xff([^\x00\xff\xd0-\xd7])")
"""Any marker except a stuffed 0xff and the restart markers, which are part of the compressed data.

If 0xff is repeated, the last one counts.
"""
_PNM_HEADER = re.compile(rb"P[2356]" + 3 * rb"(?:\s|#[^\n]*\n)+([0-9]{1,9})" + rb"\s")
TIFF_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}
"""The types of whole numbers in a TIFF's directory, and their codes for `struct`."""
WIDTH, HEIGHT, BITS, SAMPLES = 256, 257, 258, 277
TILE_WIDTH, TILE_HEIGHT = 322, 323
SUBFILE = 254
"""Tags of a TIFF's directory."""
THUMBNAIL_OR_MASK = 1 | 4
"""Bits of the tag SUBFILE."""
MAX_PAGES = 1000
"""The largest number of directories that are followed: damaged ones may point to each other."""


@dataclass(frozen=True, slots=True)
class PictureHeader:
    """The size of an encoded picture, by its header."""

    width: int
    """px"""
    height: int
    """px"""
    decoded_bytes: int
    """The bytes of the decoded pixels, or of the largest piece that is decoded at once."""


class TooLargeError(ValueError):
    """The error of a picture that takes more than MAX_DECODED_BYTES."""


def decode_picture(data: bytes, flags: int = cv2.IMREAD_UNCHANGED) -> NDArray[Any]:
    """Return the pixels of a PNG, JPEG, BMP, TIFF, WebP, PNM or OpenEXR file, as OpenCV decodes
    them.

    Raises:
        TooLargeError: the pixels take more than MAX_DECODED_BYTES. No memory was allocated for
        them. ValueError: the file is of another type, or damaged.
    """
    if read_header(data).decoded_bytes > MAX_DECODED_BYTES:
        raise TooLargeError(f"more than {MAX_DECODED_BYTES >> 30} GB when decoded")
    try:
        pixels = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise ValueError("OpenCV cannot decode it") from error
    if pixels is None:
        raise ValueError("OpenCV cannot decode it")
    return pixels


def read_header(data: bytes) -> PictureHeader:
    """Return the size that a picture's header states; ValueError if there is none."""
    kind = next((magic for magic in HEADERS if data.startswith(magic)), None)
    if kind is None:
        raise ValueError("not a picture of a known kind")
    try:
        return HEADERS[kind](data)
    except (struct.error, KeyError, IndexError, OverflowError) as error:
        raise ValueError("the header is damaged") from error


def pnm_bytes(data: bytes) -> int:
    """Return the bytes of a whole portable anymap; ValueError if its header is damaged."""
    fields = _pnm_fields(data)
    size = int(fields[1]) * int(fields[2]) * (3 if data.startswith(b"P6") else 1)
    return fields.end() + size * (1 if int(fields[3]) < 256 else 2)


def jpeg_segments(data: bytes) -> Iterator[tuple[int, int]]:
    """Yield each segment's marker and the offset of its content. A thumbnail's segments are
    skipped.
    """
    at = 2
    while match := _JPEG_MARKER.search(data, at):
        yield match[1][0], match.end()
        at = match.end() + int.from_bytes(data[match.end() : match.end() + 2], "big")


def _jpeg_header(data: bytes) -> PictureHeader:
    for marker, content_start in jpeg_segments(data):
        if marker in FRAME_MARKERS:
            bits, height, width, channels = struct.unpack_from(">BHHB", data, content_start + 2)
            return PictureHeader(width, height, height * width * channels * _whole_bytes(bits))
    raise ValueError("a JPEG without a frame")


def _png_header(data: bytes) -> PictureHeader:
    width, height, bits, colour = struct.unpack_from(">IIBB", data, 16)
    channels = {0: 1, 2: 3, 3: 4, 4: 4, 6: 4}[colour]
    return PictureHeader(width, height, width * height * channels * _whole_bytes(bits))


def _bmp_header(data: bytes) -> PictureHeader:
    (header,) = struct.unpack_from("<I", data, 14)
    width, height, _, bits = struct.unpack_from("<HHHH" if header == 12 else "<iiHH", data, 18)
    decoded_bytes = abs(width) * abs(height) * (4 if bits == 32 else 3)
    return PictureHeader(abs(width), abs(height), decoded_bytes)


def _exr_header(data: bytes) -> PictureHeader:
    """Read a list of attributes: name, type, length, content."""
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
    width = x_max - x_min + 1
    height = y_max - y_min + 1
    return PictureHeader(width, height, width * height * max(channels, 4) * 4)


def _webp_header(data: bytes) -> PictureHeader:
    """Read the first chunk, which is of one of three kinds."""
    if data[8:12] != b"WEBP":
        raise ValueError("a RIFF file of another kind")
    kind = data[12:16]
    if kind == b"VP8X":
        width = 1 + int.from_bytes(data[24:27], "little")
        height = 1 + int.from_bytes(data[27:30], "little")
    elif kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        width = 1 + (bits & 0x3FFF)
        height = 1 + (bits >> 14 & 0x3FFF)
    else:
        width, height = struct.unpack_from("<HH", data, 26)
        width &= 0x3FFF
        height &= 0x3FFF
    return PictureHeader(width, height, width * height * 4)


def _pnm_header(data: bytes) -> PictureHeader:
    fields = _pnm_fields(data)
    width = int(fields[1])
    height = int(fields[2])
    return PictureHeader(width, height, width * height * 6)


def _pnm_fields(data: bytes) -> re.Match[bytes]:
    """Return the width, the height and the largest value; the match ends where the pixels begin."""
    fields = _PNM_HEADER.match(data)
    if fields is None:
        raise ValueError("the header is damaged")
    return fields


def tiff_pages(data: bytes) -> int:
    """Return the number of pages of a TIFF that have the size of the first one, without thumbnails
    and masks. Directories that are damaged do not count.
    """
    sizes: dict[int, tuple[int, int]] = {}
    with suppress(struct.error, KeyError, OverflowError):
        offset = _first_directory(data)
        while offset and offset not in sizes and len(sizes) < MAX_PAGES:
            tags, following = _tiff_directory(data, offset)
            is_page = not tags.get(SUBFILE, 0) & THUMBNAIL_OR_MASK
            sizes[offset] = (tags[WIDTH], tags[HEIGHT]) if is_page else (0, 0)
            offset = following
    return list(sizes.values()).count(next(iter(sizes.values()), (0, 0)))


def _tiff_header(data: bytes) -> PictureHeader:
    """Read the file's first picture. Its bytes are those of one tile of it if a tile is larger."""
    tags, _ = _tiff_directory(data, _first_directory(data))
    tags = {BITS: 1, SAMPLES: 1, TILE_WIDTH: 0, TILE_HEIGHT: 0} | tags
    width, height = tags[WIDTH], tags[HEIGHT]
    tile = tags[TILE_WIDTH] * tags[TILE_HEIGHT]
    channels = max(tags[SAMPLES], 3 if tags[BITS] <= 8 else 1)  # a palette becomes colours
    decoded_bytes = max(width * height, tile) * channels * _whole_bytes(tags[BITS])
    return PictureHeader(width, height, decoded_bytes)


def _tiff_format(data: bytes) -> tuple[str, bool]:
    """Return the order of a TIFF's bytes, for `struct`, and whether its offsets have 64 bits."""
    return ("<" if data.startswith(b"II") else ">"), data[2:4] in (b"+\0", b"\0+")


def _first_directory(data: bytes) -> int:
    """Return the offset of the first directory of a TIFF."""
    order, large = _tiff_format(data)
    (offset,) = struct.unpack_from(order + ("Q" if large else "I"), data, 8 if large else 4)
    return int(offset)


def _tiff_directory(data: bytes, offset: int) -> tuple[dict[int, int], int]:
    """Return the whole numbers of a TIFF's directory by their tags, and the offset of the next
    directory; 0 if it is the last one, or if the file ends before that offset.
    """
    order, large = _tiff_format(data)
    count_format, entry_format = ("Q", "HHQ8s") if large else ("H", "HHI4s")
    (count,) = struct.unpack_from(order + count_format, data, offset)
    offset += struct.calcsize(order + count_format)
    entry_size = struct.calcsize(order + entry_format)
    tags: dict[int, int] = {}
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
    end = offset + count * entry_size
    following = data[end : end + (8 if large else 4)]
    return tags, int.from_bytes(following, "little" if order == "<" else "big")


def _whole_bytes(bits: int) -> int:
    return max(1, -(-bits // 8))


HEADERS: Mapping[bytes, Callable[[bytes], PictureHeader]] = {
    JPEG: _jpeg_header,
    PNG: _png_header,
    BMP: _bmp_header,
    EXR: _exr_header,
    WEBP: _webp_header,
    **dict.fromkeys((*PNM, *PNM_TEXT), _pnm_header),
    **dict.fromkeys(TIFF, _tiff_header),
}
"""For the first bytes of each type of file, the function that reads its header."""
