"""Pictures through a map."""

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from calib.calibration import Calibration
from calib.errors import InputError
from calib.files import make_folder, write_atomically
from calib.images import Image, list_images, read_image
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
    paths = [path for given in images for path in (list_images(given) if given.is_dir() else (given,))]
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
        write_atomically(target, _encoded(undistort(image, made), target))
        written.append(target)
    advance(len(paths) + 1, "")
    return written


def _check_names(paths: Sequence[Path], folder: Path) -> None:
    if not paths:
        raise InputError("There are no pictures to undistort: name some, or a folder that holds png, jpg, tiff, bmp or npy files.")
    seen: dict[str, Path] = {}
    for path in paths:
        if path.name in seen:
            raise InputError(f"{seen[path.name]} and {path} have the same name: undistort them into different folders.")
        seen[path.name] = path
        if path.resolve().parent == folder.resolve():
            raise InputError(f"{path} would be overwritten: give another folder with -o.")


def _encoded(image: Image, target: Path) -> bytes:
    suffix = target.suffix.lower()
    if suffix == ".npy":
        from io import BytesIO

        buffer = BytesIO()
        np.save(buffer, image, allow_pickle=False)
        return buffer.getvalue()
    return cv2.imencode(suffix, image, ENCODING.get(suffix, []))[1].tobytes()
