"""Pictures through a map."""

import os
from collections.abc import Sequence
from io import BytesIO
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from calib.calibration import Calibration
from calib.errors import InputError
from calib.files import make_folder, reading, write_atomically
from calib.images import SIXTEEN_BIT, SUFFIXES, Image, list_images, read_image
from calib.maps import DepthMap
from calib.progress import Progress

ENCODING = {".jpg": [cv2.IMWRITE_JPEG_QUALITY, 97], ".jpeg": [cv2.IMWRITE_JPEG_QUALITY, 97]}


def undistort(image: Image, made: DepthMap) -> Image:
    """A (height, width) or (height, width, 3) picture, 8 or 16 bit, as the bare pinhole camera would show it; 0 where it sees nothing."""
    straight = cv2.remap(image, made.x, made.y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    straight[~made.valid] = 0
    return cast(Image, straight)


def undistort_files(calibration: Calibration, images: Sequence[Path], depth: float, folder: Path, progress: Progress) -> list[Path]:
    """Straighten picture files, or whole folders of them, into `folder` under their own names; returns what was written."""
    paths: list[Path] = []
    for given in images:
        with reading(given):
            paths += list_images(given) if given.is_dir() else (given,)
    _check_names(paths, folder)
    advance = progress.task("Undistort", len(paths) + 1)
    made = calibration.ray_field().map_at(depth)
    make_folder(folder)
    camera = calibration.camera
    written = []
    for done, path in enumerate(paths, start=1):
        advance(done, path.name)
        image = read_image(path)
        if image.shape[:2] != (camera.height, camera.width):
            raise InputError(
                f"{path} is {image.shape[1]}x{image.shape[0]} px where the calibration is for {camera.width}x{camera.height}: "
                "give pictures of the calibrated camera mode."
            )
        target = folder / path.name
        write_atomically(target, _encoded(undistort(image, made), path))
        written.append(target)
    advance(len(paths) + 1, "")
    return written


def _check_names(paths: Sequence[Path], folder: Path) -> None:
    if not paths:
        raise InputError("There are no pictures to undistort: name some, or a folder that holds png, jpg, tiff, bmp or npy files.")
    seen: dict[str, Path] = {}
    there = os.path.realpath(folder)  # unlike Path.resolve, it lets a loop of links pass: reading says what is wrong
    for path in paths:
        if path.suffix.lower() not in SUFFIXES:
            raise InputError(f"{path} does not say what to write: give it its type's suffix, one of {', '.join(SUFFIXES)}.")
        if path.name in seen:
            raise InputError(f"{seen[path.name]} and {path} have the same name: undistort them into different folders.")
        seen[path.name] = path
        if there in (os.path.realpath(path.parent), str(Path(os.path.realpath(path)).parent)):
            raise InputError(f"{path} would be overwritten: give another folder with -o.")


def _encoded(image: Image, path: Path) -> bytes:
    """The bytes of a file of the type that the picture's own name says."""
    suffix = path.suffix.lower()
    if image.dtype == np.uint16 and suffix not in SIXTEEN_BIT:
        raise InputError(f"{path} holds 16-bit pixels, which a {suffix} cannot: rename it to its real type, png or tiff.")
    if suffix == ".npy":
        buffer = BytesIO()
        np.save(buffer, image, allow_pickle=False)
        return buffer.getvalue()
    return cv2.imencode(suffix, image, ENCODING.get(suffix, []))[1].tobytes()
