"""List and read pictures on disk, with their pixels as stored.

Older versions of OpenCV decode half a picture without an error, so a truncated file is recognised
before it is decoded.
"""

import re
import zlib
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import suppress
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
    PNM,
    TIFF,
    WEBP,
    TooLargeError,
    decode_picture,
    jpeg_segments,
    pnm_bytes,
    read_header,
    tiff_pages,
)
from calib.io.files import read_file
from calib.io.shell import shell_path
from calib.io.videos import OTHER_VIDEOS, VIDEOS

SUFFIXES = (
    *(".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".npy"),
    *(".pgm", ".ppm", ".pnm", ".webp"),
)
SIXTEEN_BIT = (".png", ".tif", ".tiff", ".npy", ".pgm", ".ppm", ".pnm")
"""The suffixes of files that can hold uint16."""
TYPES = "png, jpg, tiff, bmp, webp, pgm, ppm or npy"
"""The types of picture files, in the words of messages."""
CONVERTIBLE = (".heic", ".heif", ".avif", ".gif", ".jp2", ".jxl", ".dng")
"""Suffixes of pictures that other programs convert to a type that is read."""
OTHER_PICTURES = (
    *(".heic", ".heif", ".avif", ".gif", ".jp2", ".jxl", ".exr", ".hdr", ".pbm", ".raw"),
    *(".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw"),
    *VIDEOS,
    *OTHER_VIDEOS,
    ".bag",
)
"""Suffixes of pictures and videos that are not read as pictures."""

HEIF = {
    **dict.fromkeys((b"ftypheic", b"ftypheix", b"ftypheif", b"ftypmif1", b"ftypmsf1"), "HEIC"),
    **dict.fromkeys((b"ftypavif", b"ftypavis"), "AVIF"),
}
"""The types of phones' pictures, whatever their suffix, by the bytes 4 to 12."""

Image = NDArray[np.uint8] | NDArray[np.uint16]


class DamagedPictureError(InputError):
    """The error of a file that holds no whole picture of a type that is read."""

    def __init__(self, sentence: str, reason: str = "") -> None:
        """The reason is what follows the name of the file in a list of pictures that are left
        out.
        """
        super().__init__(sentence)
        self.reason = reason or sentence

    @staticmethod
    def of(path: Path, reason: str, advice: str) -> "DamagedPictureError":
        """Return the error of a file, with what to do about it."""
        return DamagedPictureError(f"{path} {reason}: {advice}.", reason)


def list_images(folder: Path) -> tuple[Path, ...]:
    """Return the pictures of a folder in the order of their numbers: 2.png before 10.png.

    Hidden files are ignored.
    """
    try:
        paths = [
            p
            for p in folder.iterdir()
            if p.suffix.lower() in SUFFIXES and not p.name.startswith(".") and not p.is_dir()
        ]
    except OSError as error:
        raise InputError(
            f"{folder} cannot be listed ({error.strerror}): give a folder of pictures that may be"
            " read."
        ) from error
    return tuple(sorted(paths, key=_natural_key))


def frames_folder(session: Path) -> Path:
    """Return the folder of a session's pictures, which may not exist: frames/, or the session's
    folder itself if it has pictures and no frames/.
    """
    frames = session / "frames"
    beside = session.is_dir() and not frames.is_dir() and bool(list_images(session))
    return session if beside else frames


def session_pictures(session: Path) -> tuple[Path, ...]:
    """Return the pictures of a session; none if it has none."""
    folder = frames_folder(session)
    return list_images(folder) if folder.is_dir() else ()


def list_unread(folder: Path) -> tuple[Path, ...]:
    """Return the pictures and videos of a folder that `list_images` leaves out for their type."""
    try:
        paths = [p for p in folder.iterdir() if p.suffix.lower() in OTHER_PICTURES]
    except OSError:  # list_images says it
        return ()
    return tuple(sorted((p for p in paths if not p.name.startswith(".")), key=_natural_key))


def conversion(files: Path | str) -> str:
    """Return a clause with the command that converts pictures of another type.

    Args:
        files: their path, or a pattern; it is quoted, but for a * in it.
    """
    words = "*".join(shell_path(piece) if piece else "" for piece in str(files).split("*"))
    return f"convert them, such as by `mogrify -format png {words}` (of ImageMagick)"


def conversion_of_unread(folder: Path) -> str:
    """Return the clause of `conversion` for the pictures of another type in a folder; "" if it has
    none that other programs convert.
    """
    convertible = [path for path in list_unread(folder) if path.suffix.lower() in CONVERTIBLE]
    return conversion(folder / f"*{convertible[0].suffix}") if convertible else ""


def read_image(path: Path) -> Image:
    """Return (H, W) grey or (H, W, 3) BGR pixels, uint8 or uint16, as stored: not rotated by EXIF,
    and without an alpha channel.

    Raises:
        DamagedPictureError: the file cannot be read, or is not a complete picture.
    """
    return _decode(path, picture_bytes(path))


def picture_bytes(path: Path) -> bytes:
    """Return the bytes of a picture's file; DamagedPictureError if it cannot be read, such as a
    link to nothing.
    """
    try:
        return read_file(path)
    except InputError as error:
        raise DamagedPictureError(str(error), "cannot be read") from error


def _decode(path: Path, data: bytes) -> Image:
    """Return the pixels of a file with these bytes; DamagedPictureError if it is not whole."""
    _check_complete(path, data)
    if path.suffix.lower() == ".npy":
        return _check_pixels(path, _decode_npy(path, data))
    try:
        return _check_pixels(path, decode_picture(data))
    except TooLargeError as error:
        raise DamagedPictureError.of(
            path, f"is {error}", "give a smaller picture, or remove it"
        ) from error
    except ValueError as error:
        advice = f"replace it by a {TYPES} file, or remove it"
        raise DamagedPictureError.of(path, "is not an image, or a damaged one", advice) from error


def _check_complete(path: Path, data: bytes) -> None:
    """Raise DamagedPictureError if a file is empty, of a type that only its name hides, shorter
    than it says, or has several pages; the pixels are not decoded.
    """
    if not data:
        raise DamagedPictureError.of(path, "is an empty file", "copy it again, or remove it")
    if kind := HEIF.get(data[4:12]):
        advice = "convert it to png or jpg, or remove it"
        raise DamagedPictureError.of(path, f"is {kind} inside, whatever its name says", advice)
    for magic, is_complete in COMPLETENESS_CHECKS.items():
        if data.startswith(magic) and not is_complete(data):
            advice = "copy it again, or remove it"
            raise DamagedPictureError.of(path, "is truncated or damaged", advice)
    if data.startswith(TIFF) and (pages := tiff_pages(data)) > 1:
        advice = "save each page as a picture of its own"
        raise DamagedPictureError.of(path, f"has {pages} pages", advice)


def read_grey(path: Path) -> Image:
    """Return (H, W) grey pixels, uint8 or uint16; DamagedPictureError as in
    `read_image`.
    """
    pixels = read_image(path)
    return pixels if pixels.ndim == 2 else _to_native(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY))


def image_size(path: Path) -> tuple[int, int]:
    """Return width and height, px; DamagedPictureError as in `read_image`."""
    height, width = read_image(path).shape[:2]
    return width, height


def stated_size(path: Path, data: bytes) -> tuple[int, int]:
    """Return the width and height that a picture's header states, px; DamagedPictureError as
    in `read_image`.

    A TIFF is decoded, as only that shows whether it is whole.
    """
    _check_complete(path, data)
    if path.suffix.lower() != ".npy" and not data.startswith(TIFF):
        with suppress(ValueError):  # the decoder says what is wrong, or reads it all the same
            header = read_header(data)
            return header.width, header.height
    height, width = _decode(path, data).shape[:2]
    return width, height


def most_frequent_size(sizes: Mapping[Path, tuple[int, int]]) -> tuple[int, int]:
    """Return the width and height that most pictures have; of equally frequent ones, the larger."""
    return max(Counter(sizes.values()).items(), key=lambda entry: (entry[1], entry[0]))[0]


def _natural_key(path: Path) -> tuple[list[str | int], str]:
    pieces = re.split(r"([0-9]+)", path.name.lower())
    return [int(piece) if index % 2 else piece for index, piece in enumerate(pieces)], path.name


def _decode_npy(path: Path, data: bytes) -> NDArray:
    try:
        return decode_npy(data)
    except ValueError as error:
        advice = "write it by numpy.save as (height, width) or (height, width, 3) uint8 or uint16"
        raise DamagedPictureError.of(path, "is not a whole .npy array", advice) from error


def _check_pixels(path: Path, pixels: NDArray) -> Image:
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[..., 0]
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        pixels = pixels[..., :3]
    if pixels.dtype.kind != "u" or pixels.dtype.itemsize > 2:
        reason = f"has pixels of type {pixels.dtype}"
        raise DamagedPictureError.of(path, reason, "convert it to uint8 or uint16")
    if pixels.size == 0 or not (pixels.ndim == 2 or (pixels.ndim == 3 and pixels.shape[2] == 3)):
        reason = f"is an array of shape {pixels.shape}"
        raise DamagedPictureError.of(
            path, reason, "write it as (height, width) or (height, width, 3)"
        )
    return _to_native(pixels)


def _to_native(pixels: NDArray) -> Image:
    """Return the same values, contiguous and in this machine's byte order."""
    if pixels.dtype.itemsize == 1:
        return np.ascontiguousarray(pixels, np.uint8)
    return np.ascontiguousarray(pixels, np.uint16)


def _jpeg_is_complete(data: bytes) -> bool:
    """True if the file has an end marker. Bytes after it do no harm."""
    return any(marker == 0xD9 for marker, _ in jpeg_segments(data))


def _png_is_complete(data: bytes) -> bool:
    """True if every chunk up to IEND is present and agrees with its checksum."""
    at = 8
    while at + 12 <= len(data):
        end = at + 8 + int.from_bytes(data[at : at + 4], "big")
        if zlib.crc32(data[at + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return False
        if data[at + 4 : at + 8] == b"IEND":
            return True
        at = end + 4
    return False


def _bmp_is_complete(data: bytes) -> bool:
    return len(data) >= int.from_bytes(data[2:6], "little")


def _webp_is_complete(data: bytes) -> bool:
    return len(data) >= 8 + int.from_bytes(data[4:8], "little")


def _pnm_is_complete(data: bytes) -> bool:
    try:
        return len(data) >= pnm_bytes(data)
    except ValueError:
        return False


COMPLETENESS_CHECKS: dict[bytes, Callable[[bytes], bool]] = {
    JPEG: _jpeg_is_complete,
    PNG: _png_is_complete,
    BMP: _bmp_is_complete,
    WEBP: _webp_is_complete,
    **dict.fromkeys(PNM, _pnm_is_complete),
}
"""For the first bytes of each type of file, the function that checks that a file is complete.

OpenCV itself refuses half a TIFF.
"""
