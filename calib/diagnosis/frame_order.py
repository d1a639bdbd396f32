"""When each view was taken, and which show the same pose of the board: what frames.csv says."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.calibration import Calibration


@dataclass(frozen=True, slots=True)
class Order:
    """Of the views of a calibration, one entry each."""

    times: tuple[float, ...]
    """s, or the view's number."""
    from_file: bool
    """Whether frames.csv says so; otherwise the order of the files stands for it."""
    poses: tuple[int, ...]
    """Which pose of the board it shows: the pictures of a burst share one."""


def frame_order(calibration: Calibration) -> Order:
    """From the session's frames.csv, if it is where it was and has every view."""
    rows = _rows(calibration)
    each = tuple(range(len(calibration.views)))
    said = [row.get("view", "") for row in rows]
    poses = tuple(np.unique(said, return_inverse=True)[1].tolist()) if said and all(said) else each
    try:
        times = tuple(float(row["time_s"]) for row in rows)
    except (ValueError, KeyError, TypeError):
        times = ()
    if not times or not np.isfinite(times).all() or len(set(times)) == 1:
        return Order(tuple(float(index) for index in each), from_file=False, poses=poses)
    return Order(times, from_file=True, poses=poses)


def _rows(calibration: Calibration) -> list[dict[str, str]]:
    """Of every view, or none at all."""
    session = calibration.settings.get("made_by", {}).get("session")
    if not session:
        return []
    try:
        with (Path(session) / "frames.csv").open(newline="", encoding="utf-8") as file:
            rows = {Path(row["file"]).name: row for row in csv.DictReader(file, restval="")}
        return [rows[Path(view.name).name] for view in calibration.views]
    except (OSError, ValueError, KeyError, TypeError, csv.Error):
        return []
