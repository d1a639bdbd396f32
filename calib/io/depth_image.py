"""Read depth images from disk, as RGB-D cameras and stereo programs write them."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.io.arrays import decode_npy
from calib.io.encoded_picture import decode_picture
from calib.io.files import read_file, reading

SUFFIXES = (".npy", ".png", ".tif", ".tiff", ".exr")


def read_depth_image(path: Path) -> NDArray[np.float32]:
    """Return (height, width) m; 0 is unknown. Floating-point files hold metres, 16-bit files
    millimetres.
    """
    data = read_file(path)
    try:
        pixels = decode_npy(data) if path.suffix.lower() == ".npy" else decode_picture(data)
    except ValueError:
        pixels = np.zeros(0)
    if pixels.ndim != 2 or pixels.dtype not in (np.float32, np.float64, np.uint16):
        raise InputError(
            f"{path} is not a depth image: write (height, width) floating-point metres as npy or"
            " tiff, or 16-bit millimetres as png."
        )
    return np.asarray(pixels / 1000 if pixels.dtype == np.uint16 else pixels, dtype=np.float32)


def depth_image_for(picture: Path, path: Path) -> NDArray[np.float32]:
    """Return the depth image of a picture in m. `path` is the depth image's file, or a folder with
    a depth image under the picture's name.
    """
    with reading(path):
        folder = path.is_dir()
    if not folder:
        return read_depth_image(path)
    for suffix in SUFFIXES:
        candidate = path / f"{picture.stem}{suffix}"
        if candidate.exists():
            return read_depth_image(candidate)
    raise InputError(
        f"{path} holds no depth image for {picture.name}: add {picture.stem}.npy or"
        f" {picture.stem}.png."
    )
