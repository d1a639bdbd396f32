"""Undistort picture files, videos, and folders of both into another folder. A result has the name
of its original, and a video of a type that is not written becomes .mp4.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np

from calib.apply.colour import ColourUndistorter
from calib.apply.undistorter import NEAR, Depth, Image, Undistorter
from calib.apply.video import straighten_video, straightened_name
from calib.calibration import Calibration
from calib.errors import InputError
from calib.io.depth_image import depth_image_for
from calib.io.files import make_folder, reading
from calib.io.images import (
    CONVERTIBLE,
    SIXTEEN_BIT,
    SUFFIXES,
    TYPES,
    conversion,
    list_images,
    read_image,
    session_pictures,
)
from calib.io.output_folder import OutputFolder
from calib.io.videos import OTHER_VIDEOS, VIDEOS, convert_command, list_videos
from calib.progress import Progress

ENCODING = {
    ".jpg": [cv2.IMWRITE_JPEG_QUALITY, 97],
    ".jpeg": [cv2.IMWRITE_JPEG_QUALITY, 97],
    ".webp": [cv2.IMWRITE_WEBP_QUALITY, 97],
}


@dataclass(frozen=True, slots=True)
class UndistortedFiles:
    """The result of undistorting files."""

    paths: tuple[Path, ...]
    """The files that were written."""
    cut_off: tuple[str, ...]
    """A sentence for each video that is cut off."""
    left_out: tuple[str, ...]
    """A sentence for each picture of a folder that is damaged, or of another size."""
    black: float
    """0 to 1, the part of the last picture that the camera does not see."""


@dataclass(frozen=True, slots=True)
class UndistortOptions:
    """The options for the undistorted pictures."""

    depth: Depth | Path
    """A depth in m, the file of a depth image, or a folder with a depth image for each picture,
    under the picture's name.
    """
    crop: float | None = None
    size: tuple[int, int] | None = None
    """px, width and height."""
    near: float = NEAR
    """m: the nearest distance that depth images reach."""
    colour: bool = False
    """True if the colour fringes of the cover are removed."""


def undistort_files(
    calibration: Calibration,
    inputs: Sequence[Path],
    options: UndistortOptions,
    output: OutputFolder,
    progress: Progress,
) -> UndistortedFiles:
    """Undistort pictures and videos into a folder.

    Raises:
        InputError: a file cannot be read or written, or a foreign file has the name of a new one.
            Foreign files are found before anything is written. Or a picture that was named is
            damaged or of another size than the calibration, or all pictures of a folder are.
    """
    paths: list[Path] = []
    for path in inputs:
        with reading(path):
            is_folder = path.is_dir()
            path.stat()  # raises for a path that is not there
            paths += (*_pictures(path), *list_videos(path)) if is_folder else (path,)
    paths = list(dict.fromkeys(paths))
    _check_names(paths, output.path)
    _check_depth_images(paths, options.depth, output.path)
    output.check(map(straightened_name, paths))
    first = (
        options.depth
        if not isinstance(options.depth, Path)
        else depth_image_for(paths[0], options.depth)
    )
    undistorter = (ColourUndistorter if options.colour else Undistorter)(
        calibration, first, crop=options.crop, size=options.size, near=options.near
    )
    make_folder(output.path)
    advance = progress.task("Undistort", len(paths))
    written: list[Path] = []
    cut_off: list[str] = []
    left_out: list[str] = []
    for done, path in enumerate(paths):
        advance(done, path.name)
        if isinstance(options.depth, Path) and options.depth.is_dir() and done:
            undistorter = undistorter.at(depth_image_for(path, options.depth))
        if path.suffix.lower() in VIDEOS:
            target, sentence = straighten_video(path, output, undistorter, progress)
            written.append(target)
            cut_off += filter(None, [sentence])
        else:
            try:
                straight = _undistort_picture(path, undistorter)
            except InputError as error:
                if path in inputs or (done == len(paths) - 1 and not written):
                    raise
                left_out.append(str(error))
                continue
            written.append(output.write(path.name, _encode(straight, path)))
    advance(len(paths), "")
    black = 1 - float(undistorter.valid.mean())
    return UndistortedFiles(tuple(written), tuple(cut_off), tuple(left_out), black)


def _pictures(folder: Path) -> tuple[Path, ...]:
    """Return the pictures of a folder, or of the session that it is."""
    return list_images(folder) or session_pictures(folder)


def _undistort_picture(path: Path, undistorter: Undistorter) -> Image:
    """Return the undistorted picture of a file; InputError if it is damaged or of another size."""
    image = read_image(path)
    try:
        return undistorter.undistort(image)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _check_names(paths: Sequence[Path], folder: Path) -> None:
    if not paths:
        raise InputError(
            f"There are no pictures to undistort: name some, or a folder that holds {TYPES} files,"
            " or videos."
        )
    paths_by_name: dict[str, Path] = {}
    # unlike Path.resolve, realpath accepts a loop of links, which reading then reports
    target = os.path.realpath(folder)
    for path in paths:
        if path.suffix.lower() in OTHER_VIDEOS:
            raise InputError(
                f"{path} is a video of a type that is not read: convert it by"
                f" `{convert_command(path)}`."
            )
        if path.suffix.lower() in CONVERTIBLE:
            raise InputError(f"{path} is of a type that is not read: {conversion(path)}.")
        if path.suffix.lower() not in (*SUFFIXES, *VIDEOS):
            raise InputError(
                f"{path} is neither a picture nor a video by its name: it must end in one of"
                f" {', '.join((*SUFFIXES, *VIDEOS))}."
            )
        name = straightened_name(path)
        if name in paths_by_name:
            raise InputError(
                f"{paths_by_name[name]} and {path} would both become {name}: undistort them into"
                " different folders."
            )
        paths_by_name[name] = path
        if target in (os.path.realpath(path.parent), str(Path(os.path.realpath(path)).parent)):
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


def _encode(image: Image, path: Path) -> bytes:
    """Return the bytes of a file with the image, of the type of the path's suffix."""
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
    # OpenCV's .pgm takes grey pixels alone, .ppm colours alone
    encoder = ".pnm" if suffix in (".pgm", ".ppm") else suffix
    return cv2.imencode(encoder, image, ENCODING.get(suffix, []))[1].tobytes()
