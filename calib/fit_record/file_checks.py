"""Check the two files of a calibration as they are read: the keys of calibration.yaml, and the
arrays of calibration.npz.

A person may have edited the files, or a disk may have damaged them. Every check raises ValueError
with a sentence, which `read_content` (calib.calibration_file) completes with the file's name.

CALIBRATION describes the value of each key of calibration.yaml. Board, camera and cover follow the
rules of session.yaml, so they have no shape here.
"""

import math
from collections.abc import Mapping, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError, brief
from calib.fit_record.outcome import JointOutcome
from calib.fit_record.shapes import RECORD
from calib.io.arrays import decode_npz
from calib.io.files import read_file, reading
from calib.io.frames_table import LATEST_S
from calib.io.shapes import (
    anything,
    choice,
    count,
    either,
    flag,
    many,
    maybe,
    number,
    positive,
    record,
    table,
    text,
)
from calib.optics.relief import Relief
from calib.session.board import Board

MAX_AMPLITUDE = 10.0
"""m, of the relief. Wide radial functions cancel each other: a measured dome that is uneven by 5 um
has amplitudes of 0.12 m.
"""
MAX_NUMBER = 1e12
"""Largest number in an array, in SI units or px; its square limits a covariance. Coefficients of a
rational lens that cancel each other have standard deviations of 1e7 of their scale.
"""
STAGES = ("pinhole", "cover", "cover+rbf", "cover+rbf+effects")
"""The stages of a fit, in their order; a fit may lack any but the first."""
NAN_ALLOWED = ("corners", "times_s", "blurs", "point_covariances")
"""The arrays that have NaN where something is unknown: a corner that was not seen, for example."""
COVER_STAGES = STAGES[1:3]
COVER = either(many(table(anything)), table(anything))
CALIBRATION = record(
    {
        "refracal": text,
        "arrays_sha256": text,
        "camera": table(anything),
        "cover": COVER,
        "declared": record({"camera": table(anything), "cover": COVER}, {"doubted": many(text)}),
        "relief": maybe(
            record(
                {
                    "low": anything,
                    "high": anything,
                    "grid": anything,
                    "beta": positive,
                    "exact_hit": flag,
                },
                {"inset": number, "anchor": anything, "size": many(positive)},
            )
        ),
        "effects": many(
            record(
                {
                    "name": text,
                    "form": table(either(flag, number, text, many(number), many(text))),
                    "parameters": table(anything),
                }
            )
        ),
        "gauge": text,
        "settings": record({}, RECORD),
        "noise_px": number,
        "stages": many(record({"name": choice(*STAGES), "rms_px": number, "rmse_cm": number})),
        "frames_rejected": many(record({"file": text, "reason": text})),
    },
    {
        "board": table(anything),
        "target": table(anything),
        "uncertainty": record(
            {
                "method": text,
                "views": count,
                "inflation": positive,
                "view_scatter": number,
                "corner_scatter": number,
                "heavy_views": table(number),
            }
        ),
    },
)


def relief_from_yaml(mapping: Mapping[str, Any]) -> Relief:
    """Return the relief that a mapping describes.

    Raises:
        LookupError, TypeError, ValueError: the mapping describes no relief.
    """
    low = _pair(mapping["low"], "low")
    high = _pair(mapping["high"], "high")
    grid = _pair(mapping["grid"], "grid")
    relief = Relief(
        low,
        high,
        (int(grid[0]), int(grid[1])),
        float(mapping["beta"]),
        inset=float(mapping.get("inset", 0.0)),
        anchor=_pair(mapping["anchor"], "anchor") if "anchor" in mapping else None,
        size=_size(mapping["size"]) if "size" in mapping else None,
    )
    if not 0 <= relief.inset < 1:
        raise ValueError("relief.inset is not from 0 to below 1")
    if relief.grid != grid or min(relief.grid) < 2:
        raise ValueError("relief.grid is not two whole numbers of 2 or more")
    if not (low[0] < high[0] and low[1] < high[1] and 0 < relief.beta < math.inf):
        raise ValueError("relief.low is not below relief.high, or relief.beta not above 0")
    return relief


def _size(written: Sequence[float]) -> tuple[float, float, float]:
    """Return the three numbers of `Relief.size`."""
    if len(written) != 3 or not all(map(math.isfinite, written)):
        raise ValueError("relief.size is not three numbers")
    first, second, distance = map(float, written)
    return first, second, distance


def _pair(written: object, key: str) -> tuple[float, float]:
    """Return the two finite numbers of a key of the relief."""
    match written:
        case [int() | float() as first, int() | float() as second] if math.isfinite(
            first
        ) and math.isfinite(second):
            return first, second
    raise ValueError(f"relief.{key} is not two numbers")


def check_stages(names: Sequence[str], *, has_cover: bool, has_views: bool) -> None:
    """Raise ValueError if no fit has these stages in this order."""
    places = [STAGES.index(name) for name in names]
    if places != sorted(set(places)) or (places and places[0] != 0):
        raise ValueError(f"stages are not some of {', '.join(STAGES)} in this order")
    if has_views and not names:
        raise ValueError("stages are missing")
    if not has_cover and set(names) & set(COVER_STAGES):
        raise ValueError("there is a stage of the cover and no cover")


def check_joint(joint: JointOutcome | None, *, has_covariance: bool, has_relief: bool) -> None:
    """Raise ValueError if the record of the joint fit lacks an input of the covariance."""
    if has_covariance and not joint:
        raise ValueError("settings.sigma_px is missing")
    if has_covariance and has_relief and not (joint and joint.relief_prior):
        raise ValueError("settings.relief_prior is missing")


def check_arrays(
    arrays: Mapping[str, NDArray[Any]], relief: Relief | None, board: Board, per_view: int
) -> None:
    """Raise ValueError if the arrays have inconsistent shapes or implausible values.

    Args:
        arrays: those of calibration.npz, by name.
        relief: the relief whose amplitudes are among them.
        board: the board of the views.
        per_view: number of parameters of each view.
    """
    _check_shapes(arrays, _expected_shapes(arrays, relief, board, per_view))
    if not (np.abs(arrays["amplitudes"]) < MAX_AMPLITUDE).all():
        raise ValueError("amplitudes are not those of a glass")
    _check_view_arrays(arrays, has_grid=board.has_grid)
    _check_covariance(arrays["covariance"])


def _expected_shapes(
    arrays: Mapping[str, NDArray[Any]], relief: Relief | None, board: Board, per_view: int
) -> dict[str, tuple[int, ...]]:
    """Return the shape that each array of numbers must have, by its name; optional arrays only if
    the file has them.
    """
    views, parameters = len(arrays["names"]), len(arrays["covariance"])
    shapes: dict[str, tuple[int, ...]] = {
        "amplitudes": relief.grid if relief else (0, 0),
        "poses": (views, per_view),
        "covariance": (parameters, parameters),
        "corners": (views, board.count, 2),
        "weights": (views, board.count),
        "times_s": (views,),
    }
    if "corners_at" in arrays:
        shapes["corners_at"] = (len(arrays["corners_at"]), 3)
    if "blurs" in arrays:
        shapes["blurs"] = (views, board.count, 2)
    if not board.has_grid:
        shapes["target"] = board.points().shape
        if "point_covariances" in arrays:
            shapes["point_covariances"] = (views, board.count, 2, 2)
    return shapes


def _check_shapes(
    arrays: Mapping[str, NDArray[Any]], shapes: Mapping[str, tuple[int, ...]]
) -> None:
    """Raise ValueError unless every array is of float64, has its shape, and no value is too large;
    NaN counts as too large where it is not allowed.
    """
    for name, shape in shapes.items():
        array = arrays[name]
        if array.shape != shape or array.dtype != np.float64:
            raise ValueError(
                f"{name} are {array.dtype} of shape {array.shape} where float64 of shape {shape} is"
                " expected"
            )
        limit = MAX_NUMBER**2 if name == "covariance" else MAX_NUMBER
        if name not in NAN_ALLOWED and not (np.abs(array) < limit).all():
            raise ValueError(f"{name} are not all numbers that a fit would leave")


def _check_view_arrays(arrays: Mapping[str, NDArray[Any]], *, has_grid: bool) -> None:
    """Raise ValueError if the names, corners or times of the views are not those of views."""
    views = len(arrays["names"])
    for name in ("names", "pose_ids"):
        if arrays[name].shape != (views,) or (views and arrays[name].dtype.kind != "U"):
            raise ValueError(f"{name} are not a text for each view")
    visible = arrays["weights"] > 0
    if (
        (arrays["weights"] < 0).any()
        or not visible.any(axis=1).all()
        or not (np.abs(arrays["corners"][visible]) < MAX_NUMBER).all()
    ):
        raise ValueError("corners that were seen are not all somewhere, or a view has none")
    if not has_grid and "point_covariances" in arrays:
        covariances = arrays["point_covariances"][visible]
        if not np.isfinite(covariances).all() or (np.linalg.eigvalsh(covariances) <= 0).any():
            raise ValueError("point_covariances are not all covariances")
    if "blurs" in arrays and ((arrays["blurs"] <= 0) | (arrays["blurs"] >= MAX_NUMBER)).any():
        raise ValueError("blurs are not all widths in px")
    if (np.abs(arrays["times_s"]) >= LATEST_S).any():
        raise ValueError("times_s are not all times in s")


def _check_covariance(covariance: NDArray[np.float64]) -> None:
    """Raise ValueError unless a covariance is symmetric, with variances of 0 or more."""
    sigmas = np.sqrt(np.abs(covariance.diagonal()))
    # the rounding error of an entry near zero is relative to its sigmas, not to itself
    tolerance = 1e-6 * np.outer(sigmas, sigmas)
    if (np.abs(covariance - covariance.T) > tolerance).any() or (covariance.diagonal() < 0).any():
        raise ValueError("covariance is not symmetric with variances of 0 or more")


def read_arrays(path: Path) -> tuple[dict[str, NDArray[Any]], str]:
    """Return the arrays of calibration.npz and the SHA-256 of the file.

    Raises:
        InputError: the file is missing or damaged.
    """
    with reading(path):
        if not path.exists():
            raise InputError(
                f"{path} is missing: keep calibration.yaml and calibration.npz in one folder."
            )
    data = read_file(path)
    try:
        return decode_npz(data), sha256(data).hexdigest()
    except ValueError as error:
        raise InputError(f"{path} is damaged ({brief(error)}): fit the session again.") from error
