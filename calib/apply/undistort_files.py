"""Picture files, videos, and folders of both, straightened into another folder under their own
names.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np

from calib.apply.undistorter import NEAR, Depth, Image, Undistorter
from calib.apply.video import VIDEOS, list_videos, straighten_video
from calib.calibration import Calibration
from calib.errors import InputError
from calib.io.depth_image import depth_image_for
from calib.io.files import make_folder, reading
from calib.io.images import SIXTEEN_BIT, SUFFIXES, list_images, read_image
from calib.io.output_folder import OutputFolder
from calib.progress import Progress

ENCODING = {".jpg": [cv2.IMWRITE_JPEG_QUALITY, 97], ".jpeg": [cv2.IMWRITE_JPEG_QUALITY, 97]}


@dataclass(frozen=True, slots=True)
class Straightened:
    """The files that were written, and a sentence for each video that is cut off."""

    paths: tuple[Path, ...]
    cut_off: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Wanted:
    """What the straightened pictures show."""

    depth: Depth | Path
    """m; or a depth image's file; or a folder with a depth image for each picture, under the
    picture's name.
    """
    crop: float | None = None
    size: tuple[int, int] | None = None
    """px, width and height."""
    near: float = NEAR
    """m: the nearest that depth images reach."""


def undistort_files(
    calibration: Calibration,
    given: Sequence[Path],
    wanted: Wanted,
    output: OutputFolder,
    progress: Progress,
) -> Straightened:
    """Straighten pictures and videos into a folder.

    Raises:
        InputError: a file cannot be read or written, or a foreign file has the name of a new one;
            the latter before anything is written.
    """
    paths: list[Path] = []
    for one in given:
        with reading(one):
            paths += (*list_images(one), *list_videos(one)) if one.is_dir() else (one,)
    _check_names(paths, output.path)
    _check_depth_images(paths, wanted.depth, output.path)
    output.check(path.name for path in paths)
    first = (
        wanted.depth
        if not isinstance(wanted.depth, Path)
        else depth_image_for(paths[0], wanted.depth)
    )
    undistorter = Undistorter(
        calibration, first, crop=wanted.crop, size=wanted.size, near=wanted.near
    )
    make_folder(output.path)
    advance = progress.task("Undistort", len(paths))
    written: list[Path] = []
    cut_off: list[str] = []
    for done, path in enumerate(paths):
        advance(done, path.name)
        if isinstance(wanted.depth, Path) and wanted.depth.is_dir() and done:
            undistorter = undistorter.at(depth_image_for(path, wanted.depth))
        if path.suffix.lower() in VIDEOS:
            target, sentence = straighten_video(path, output, undistorter, progress)
            written.append(target)
            cut_off += filter(None, [sentence])
        else:
            image = _encoded(_straightened(path, undistorter), path)
            written.append(output.write(path.name, image))
    advance(len(paths), "")
    return Straightened(tuple(written), tuple(cut_off))


def _straightened(path: Path, undistorter: Undistorter) -> Image:
    image = read_image(path)
    try:
        return undistorter.undistort(image)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _check_names(paths: Sequence[Path], folder: Path) -> None:
    if not paths:
        raise InputError(
            "There are no pictures to undistort: name some, or a folder that holds png, jpg, tiff,"
            " bmp or npy files, or videos."
        )
    seen: dict[str, Path] = {}
    there = os.path.realpath(
        folder
    )  # unlike Path.resolve, it lets a loop of links pass: reading says what is wrong
    for path in paths:
        if path.suffix.lower() not in (*SUFFIXES, *VIDEOS):
            raise InputError(
                f"{path} does not say what to write: give it its type's suffix, one of"
                f" {', '.join((*SUFFIXES, *VIDEOS))}."
            )
        if path.name in seen:
            raise InputError(
                f"{seen[path.name]} and {path} have the same name: undistort them into different"
                " folders."
            )
        seen[path.name] = path
        if there in (os.path.realpath(path.parent), str(Path(os.path.realpath(path)).parent)):
            raise InputError(f"{path} would be overwritten: give another folder with -o.")


def _check_depth_images(paths: Sequence[Path], depth: Depth | Path, folder: Path) -> None:
    """Refuse to write over a depth image, which has the name of its picture or another suffix."""
    if not isinstance(depth, Path):
        return
    depths = depth if depth.is_dir() else depth.parent
    if os.path.realpath(depths) == os.path.realpath(folder) and (
        depth.is_dir() or depth.name in {path.name for path in paths}
    ):
        raise InputError(
            f"{folder} has the depth images that this command reads: give another folder with -o."
        )


def _encoded(image: Image, path: Path) -> bytes:
    """The bytes of a file of the type that the picture's own name says."""
    suffix = path.suffix.lower()
    if image.dtype == np.uint16 and suffix not in SIXTEEN_BIT:
        raise InputError(
            f"{path} holds 16-bit pixels, which a {suffix} cannot: rename it to its real type, png"
            " or tiff."
        )
    if suffix == ".npy":
        buffer = BytesIO()
        np.save(buffer, image, allow_pickle=False)
        return buffer.getvalue()
    return cv2.imencode(suffix, image, ENCODING.get(suffix, []))[1].tobytes()
