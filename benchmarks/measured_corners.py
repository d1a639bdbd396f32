"""Corners of measured pictures, by how well a fit to other views predicts them: `python -m benchmarks.measured_corners SESSION`.

Nobody knows where the corners of a measured picture are. So each estimator's corners calibrate the camera, with the board's shape and a
free field of its print estimated, and are predicted by fits to the other views, in folds: the error is the estimator's and the model's, and
the model is one. Every corner weighs alike, and only views that all of them have are compared.
"""

import shutil
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import torch
import yaml
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from calib.corners.corners_file import write_corners
from calib.corners.detect import refine
from calib.corners.detect_all import detect
from calib.corners.view import View
from calib.diagnosis.held_out import folds, hold_out
from calib.diagnosis.named_effects import with_named
from calib.diagnosis.starting_model import model_of
from calib.fitting.fit import fit
from calib.fitting.stages import Settings
from calib.progress import Silent
from calib.session.board import Board
from calib.session.session import read_session
from calib.threads import single_thread

Floats = NDArray[np.float64]
WINDOWS = (3, 5, 11)
"""px, cornerSubPix's half-sizes"""
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
PATTERN = ("board_shape", "free_field")


def estimators(board: Board) -> dict[str, Callable[[NDArray[np.uint8], Floats], Floats | None]]:
    """By name: from a grey picture and corners that are within a pixel, to (count, 2) px."""

    def sectors(flags: int) -> Callable[[NDArray[np.uint8], Floats], Floats | None]:
        return lambda grey, start: _sectors(grey, start, board, flags)

    def sub_pixel(half: int) -> Callable[[NDArray[np.uint8], Floats], Floats | None]:
        return lambda grey, start: _sub_pixel(grey, start, half)

    return {
        "patches": lambda _, start: start,
        "cornerSubPix on an enlarged, smoothed picture": lambda grey, start: refine(grey, start, board),
        "SB": sectors(0),
        "SB, ACCURACY": sectors(cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE),
        **{f"cornerSubPix {half}": sub_pixel(half) for half in WINDOWS},
    }


def _sectors(grey: NDArray[np.uint8], start: Floats, board: Board, flags: int) -> Floats | None:
    found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=flags)
    if not found:
        return None
    near = np.asarray(corners, np.float64).reshape(-1, 2)
    apart = np.linalg.norm(near - start[:, None], axis=-1)
    return np.asarray(near[apart.argmin(1)])


def _sub_pixel(grey: NDArray[np.uint8], start: Floats, half: int) -> Floats:
    found = cv2.cornerSubPix(grey, start.astype(np.float32).reshape(-1, 1, 2), (half, half), (-1, -1), STOP)
    return np.asarray(found, np.float64).reshape(-1, 2)


def held_out(folder: Path, views: list[View], described: dict[str, object]) -> tuple[float, float]:
    """Fitted and held out, px RMS."""
    write_corners(folder / "corners.vnl", views)
    (folder / "session.yaml").write_text(yaml.safe_dump({**described, "corners": "corners.vnl"}))
    made = with_named(fit(read_session(folder), Settings(), Silent()), PATTERN, Silent())
    model, observations = model_of(made), made.observations
    with single_thread():
        joint = model.fitted(observations, torch.from_numpy(made.poses))
        left = hold_out(model, observations, joint, folds(range(len(made.views))))
    return made.stages[-1].rms_px, left.rms


def main() -> None:
    with TemporaryDirectory() as place:
        folder = Path(place) / "session"
        shutil.copytree(sys.argv[1], folder)
        described = yaml.safe_load((folder / "session.yaml").read_text())
        session = read_session(folder)
        found = [view for view in detect(session.frames, session.board).views if view.seen.all()]
        pictures = {path.name: path for path in session.frames}
        measured: dict[str, list[Floats | None]] = {name: [] for name in estimators(session.board)}
        for view in track(found, "Pictures"):
            grey = cv2.imread(str(pictures[view.name]), cv2.IMREAD_GRAYSCALE)
            assert grey is not None
            for name, estimate in estimators(session.board).items():
                measured[name].append(estimate(np.asarray(grey, np.uint8), view.corners))
        every = [all(own[index] is not None for own in measured.values()) for index in range(len(found))]
        table = Table("corners", "fitted, px", "held out, px", title=f"{sum(every)} views of {session.board} that all of them have")
        equal = np.ones(session.board.count)
        for name, own in track(measured.items(), "Fits"):
            views = [
                View(view.name, corners, equal)
                for view, corners, kept in zip(found, own, every, strict=True)
                if kept and corners is not None
            ]
            table.add_row(name, *(f"{px:.4f}" for px in held_out(folder, views, described)))
        weighed = [replace(view, covariance=None) for view, kept in zip(found, every, strict=True) if kept]
        table.add_row("patches, weighted as calib does", *(f"{px:.4f}" for px in held_out(folder, weighed, described)))
    Console(width=120).print(table)


if __name__ == "__main__":
    main()
