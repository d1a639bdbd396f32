"""Read the folder points/ of a session whose target is points."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError, brief
from calib.io.arrays import decode_npz
from calib.io.files import read_file, reading
from calib.session.point_bins import bin_points
from calib.session.point_target import PointView

FOLDER = "points"
CONTENT = "pixels (N, 2) px, target (N, 3) m and covariance (N, 2, 2) px^2"
ROWS = {"pixels": (2,), "target": (3,), "covariance": (2, 2)}
MAX_HEIGHT = 1e-9
"""m: if a point is farther from the plane z = 0, the target is not flat."""


def point_files(folder: Path) -> tuple[Path, ...]:
    """Return the files of points of a session's folder, by name.

    Raises:
        InputError: there are none.
    """
    files = tuple(sorted((folder / FOLDER).glob("*.npz")))
    if not files:
        raise InputError(
            f"{folder / FOLDER} has no .npz files: put a file for each view there, such as"
            f" 0000.npz, with {CONTENT}."
        )
    return files


def read_point_view(path: Path, width: int, height: int) -> PointView:
    """Return the points of one view as `read_dense_points`, but fewer (`bin_points`)."""
    return bin_points(read_dense_points(path, width, height))


def read_dense_points(path: Path, width: int, height: int) -> PointView:
    """Return all points of one view in a picture of this size in px.

    Raises:
        InputError: the file is damaged, or its numbers cannot be those of points.
    """
    with reading(path):
        data = read_file(path)
    try:
        arrays = decode_npz(data)
    except ValueError as error:
        message = f"{path} is not a whole .npz file ({brief(error)}): write it by numpy.savez."
        raise InputError(message) from error
    if missing := [name for name in ROWS if name not in arrays]:
        raise InputError(f"{path} lacks {', '.join(missing)}: it needs {CONTENT}.")
    count = len(arrays["pixels"]) if arrays["pixels"].ndim else 0
    numbers = {name: _numbers(path, name, arrays[name], (count, *ROWS[name])) for name in ROWS}
    pixels, target, covariance = numbers["pixels"], numbers["target"], numbers["covariance"]
    outside = ((pixels < -0.5) | (pixels > np.array([width, height]) - 0.5)).any(-1)
    if outside.any():
        x, y = pixels[outside][0]
        raise InputError(
            f"{path} has a pixel at ({x:g}, {y:g}), outside the camera's {width}x{height} px:"
            " correct camera.width and camera.height, or leave the point out."
        )
    mirrored = np.abs(covariance - covariance.swapaxes(1, 2)) > 1e-6 * np.abs(covariance).max(
        initial=0.0
    )
    if mirrored.any() or (np.linalg.eigvalsh(covariance) <= 0).any():
        raise InputError(
            f"{path} has a covariance that is not symmetric with variances above 0: give that of"
            " each pixel in px^2, such as 0.01 on the diagonal for 0.1 px."
        )
    is_flat = bool((np.abs(target[:, 2]) <= MAX_HEIGHT).all())
    return PointView(path.name, pixels, target[:, :2] if is_flat else target, covariance)


def _numbers(
    path: Path, name: str, array: NDArray[np.generic], shape: tuple[int, ...]
) -> NDArray[np.float64]:
    """Return the array as float64; InputError if it has another shape or is not finite."""
    if array.shape != shape or array.dtype.kind not in "fiu":
        raise InputError(
            f"{path}: {name} is {array.dtype} of shape {array.shape} where numbers of shape"
            f" {shape} are expected: it needs {CONTENT}."
        )
    numbers = array.astype(np.float64)
    if not np.isfinite(numbers).all():
        raise InputError(f"{path}: {name} has numbers that are not finite: leave these points out.")
    return numbers
