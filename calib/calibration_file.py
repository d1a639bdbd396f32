"""The parts of a calibration's two files: what calibration.yaml says of a relief, and the arrays of calibration.npz, checked."""

import math
from collections.abc import Mapping
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.io.files import reading
from calib.optics.relief import Relief
from calib.session.board import Board


def relief_from_yaml(said: Mapping[str, Any]) -> Relief:
    """LookupError, TypeError or ValueError where the mapping is of none."""
    low, high = _pair(said["low"], "low"), _pair(said["high"], "high")
    first, second = grid = _pair(said["grid"], "grid")
    relief = Relief(low, high, (int(first), int(second)), float(said["beta"]))
    if relief.grid != grid or min(relief.grid) < 2:
        raise ValueError("relief.grid is not two whole numbers of 2 or more")
    if not (low[0] < high[0] and low[1] < high[1] and 0 < relief.beta < math.inf):
        raise ValueError("relief.low is not below relief.high, or relief.beta not above 0")
    return relief


def _pair(written: object, key: str) -> tuple[float, float]:
    match written:
        case [int() | float() as first, int() | float() as second] if math.isfinite(first) and math.isfinite(second):
            return first, second
    raise ValueError(f"relief.{key} is not two numbers")


def check_arrays(arrays: Mapping[str, NDArray[Any]], relief: Relief | None, board: Board, per_view: int) -> None:
    """ValueError where an array has not the shape that the others ask for; `per_view` parameters of each view."""
    views, parameters = len(arrays["names"]), len(arrays["covariance"])
    shapes = {
        "amplitudes": relief.grid if relief else (0, 0),
        "poses": (views, per_view),
        "covariance": (parameters, parameters),
        "corners": (views, board.count, 2),
        "weights": (views, board.count),
        "times_s": (views,),
    }
    for name, shape in shapes.items():
        array = arrays[name]
        if array.shape != shape or array.dtype != np.float64:
            raise ValueError(f"{name} are {array.dtype} of shape {array.shape} where float64 of shape {shape} is expected")


def read_arrays(path: Path) -> tuple[dict[str, NDArray[Any]], str]:
    """The arrays, and the SHA-256 of their file."""
    with reading(path):
        if not path.exists():
            raise InputError(f"{path} is missing: keep calibration.yaml and calibration.npz in one folder.")
        data = path.read_bytes()
    try:
        with np.load(BytesIO(data), allow_pickle=False) as file:
            return dict(file), sha256(data).hexdigest()
    except Exception as error:  # numpy and zipfile raise a dozen kinds for a damaged file
        raise InputError(f"{path} is damaged ({error}): fit the session again.") from error
