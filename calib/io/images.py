"""Pictures on disk: which there are, and their pixels as stored.

Older OpenCV decodes half a picture without a word, so a truncated file is recognised before it is
decoded.
"""

import re
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.io.arrays import decode_npy
from calib.io.encoded_picture import (
    BMP,
    JPEG,
    PNG,
    TooLargeError,
    decode_picture,
    jpeg_segments,
)
from calib.io.files import read_file

SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".npy")
SIXTEEN_BIT = (".png", ".tif", ".tiff", ".npy")
"""Those that can hold uint16."""

Image = NDArray[np.uint8] | NDArray[np.uint16]


def list_images(folder: Path) -> tuple[Path, ...]:
    """The pictures of a folder, in the order a person counts: 2.png before 10.png.

    Hidden files are left out.
    """
    try:
        found = [
            p
            for p in folder.iterdir()
            if p.suffix.lower() in SUFFIXES and not p.name.startswith(".") and not p.is_dir()
        ]
    except OSError as error:
        raise InputError(
            f"{folder} cannot be listed ({error.strerror}): give a folder of pictures that may be"
            " read."
        ) from error
    return tuple(sorted(found, key=_natural))


def read_image(path: Path) -> Image:
    """(H, W) grey or (H, W, 3) BGR pixels, uint8 or uint16, as stored: not turned by EXIF, without
    an alpha channel.
    """
    data = read_file(path)
    if not data:
        raise InputError(f"{path} is an empty file: copy it again, or remove it.")
    if path.suffix.lower() == ".npy":
        return _checked(path, _decode_npy(path, data))
    for magic, is_whole in WHOLE.items():
        if data.startswith(magic) and not is_whole(data):
            raise InputError(f"{path} is truncated or damaged: copy it again, or remove it.")
    try:
        return _checked(path, decode_picture(data))
    except TooLargeError as error:
        raise InputError(f"{path} is {error}: give a smaller picture, or remove it.") from error
    except ValueError as error:
        raise InputError(
            f"{path} is not an image, or a damaged one: replace it by a png, jpg, tiff, bmp or npy"
            " file, or remove it."
        ) from error


def read_grey(path: Path) -> Image:
    """(H, W) pixels, uint8 or uint16."""
    pixels = read_image(path)
    return pixels if pixels.ndim == 2 else _native(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY))


def image_size(path: Path) -> tuple[int, int]:
    """Width and height, px."""
    height, width = read_image(path).shape[:2]
    return width, height


def _natural(path: Path) -> tuple[list[str | int], str]:
    parts = re.split(r"([0-9]+)", path.name.lower())
    return [int(part) if odd % 2 else part for odd, part in enumerate(parts)], path.name


def _decode_npy(path: Path, data: bytes) -> NDArray:
    try:
        return decode_npy(data)
    except ValueError as error:
        raise InputError(
            f"{path} is not a whole .npy array: write it by numpy.save as (height, width) or"
            " (height, width, 3) uint8 or uint16."
        ) from error


def _checked(path: Path, pixels: NDArray) -> Image:
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[..., 0]
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        pixels = pixels[..., :3]
    if pixels.dtype.kind != "u" or pixels.dtype.itemsize > 2:
        raise InputError(
            f"{path} has pixels of type {pixels.dtype}: convert it to uint8 or uint16."
        )
    if pixels.size == 0 or not (pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 3)):
        raise InputError(
            f"{path} is an array of shape {pixels.shape}: write it as (height, width) or (height,"
            " width, 3)."
        )
    return _native(pixels)


def _native(pixels: NDArray) -> Image:
    """The same numbers, contiguous and in this machine's byte order."""
    if pixels.dtype.itemsize == 1:
        return np.ascontiguousarray(pixels, np.uint8)
    return np.ascontiguousarray(pixels, np.uint16)


def _jpeg_is_whole(data: bytes) -> bool:
    """True if the end marker comes; bytes after it do no harm."""
    return any(marker == 0xD9 for marker, _ in jpeg_segments(data))


def _png_is_whole(data: bytes) -> bool:
    """Whether every chunk up to IEND is there and agrees with its checksum."""
    at = 8
    while at + 12 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        if zlib.crc32(data[at + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return False
        if data[at + 4 : at + 8] == b"IEND":
            return True
        at = end + 4
    return False


def _bmp_is_whole(data: bytes) -> bool:
    return len(data) >= int.from_bytes(data[2:6], "little")


WHOLE: dict[bytes, Callable[[bytes], bool]] = {
    JPEG: _jpeg_is_whole,
    PNG: _png_is_whole,
    BMP: _bmp_is_whole,
}
"""How to tell that a file is complete, by the bytes it starts with.

OpenCV refuses half a TIFF by itself.
"""
