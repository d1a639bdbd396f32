"""Corners of pictures, by how well a fit to other views predicts them: `python -m
benchmarks.measured_corners SESSION [EFFECT ...]`.

Nobody knows where the corners of a measured picture are. So each estimator's corners calibrate the
camera, and are predicted by a fit to
other views: to those of the session, where it has a holdout folder, else in folds. The board's
    shape and a free field of its print are
estimated, and what else is known to be in the session. The error is the estimator's and the
model's, and the model is one. Every corner weighs alike, and only views that all estimators have
are compared; one that finds less than nine tenths of the views is left out.
"""

import shutil
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
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
from calib.diagnosis.requested_effects import with_requested
from calib.fit_record.request import Settings
from calib.fitting.evaluate import evaluate
from calib.fitting.fit import fit
from calib.inference.calibration_model import full_model
from calib.inference.cross_validation import fold_split, hold_out
from calib.progress import Silent
from calib.session.board import Board
from calib.session.session import read_session
from calib.threads import single_thread
from fixtures import mrgingham

Floats = NDArray[np.float64]
Estimator = Callable[[NDArray[np.uint8], Floats], Floats | None]
"""From a grey picture and corners that are within a pixel, to (count, 2) px."""
WINDOWS = (3, 5, 11)
"""px, cornerSubPix's half-sizes"""
STOP = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
PATTERN = ("board_shape", "free_field")
OURS = "patches"
LIMIT = 3.0  # px: a corner further from ours is another, or none
ENOUGH = 0.9  # of the views


@dataclass(frozen=True, slots=True)
class Folder:
    """A session's folder, or that of its held-out views, and its corners by each estimator."""

    path: Path
    views: tuple[View, ...]
    """The views whose boards are completely visible, with our corners."""
    by: dict[str, list[Floats | None]]


def estimators(board: Board) -> dict[str, Estimator]:
    def sectors(flags: int) -> Estimator:
        return lambda grey, start: _sectors(grey, start, board, flags)

    def sub_pixel(half: int) -> Estimator:
        return lambda grey, start: _sub_pixel(grey, start, half)

    def gingham(method: str) -> Estimator:
        return lambda grey, start: _near(mrgingham.find(grey, board, method), start)

    return {
        OURS: lambda _, start: start,
        "cornerSubPix on an enlarged, smoothed picture": lambda grey, start: refine(
            grey, start, board
        ),
        "SB": sectors(0),
        "SB, ACCURACY": sectors(cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE),
        **{f"cornerSubPix {half}": sub_pixel(half) for half in WINDOWS},
        **(
            {method: gingham(method) for method in mrgingham.WAYS}
            if mrgingham.can_find(board)
            else {}
        ),
    }


def _sectors(grey: NDArray[np.uint8], start: Floats, board: Board, flags: int) -> Floats | None:
    is_found, corners = cv2.findChessboardCornersSB(grey, (board.columns, board.rows), flags=flags)
    return _near(np.asarray(corners, np.float64).reshape(-1, 2), start) if is_found else None


def _near(result: Floats | None, start: Floats) -> Floats | None:
    """In our order; None where one is too far from ours."""
    nearest = None if result is None else mrgingham.nearest(result, start)
    return (
        nearest
        if nearest is not None and np.linalg.norm(nearest - start, axis=1).max() < LIMIT
        else None
    )


def _sub_pixel(grey: NDArray[np.uint8], start: Floats, half: int) -> Floats:
    refined = cv2.cornerSubPix(
        grey, start.astype(np.float32).reshape(-1, 1, 2), (half, half), (-1, -1), STOP
    )
    return np.asarray(refined, np.float64).reshape(-1, 2)


def measured(path: Path) -> Folder:
    session = read_session(path)
    views = tuple(view for view in detect(session.frames, session.board).views if view.seen.all())
    pictures = {picture.name: picture for picture in session.frames}
    by: dict[str, list[Floats | None]] = {name: [] for name in estimators(session.board)}
    for view in track(views, f"Pictures of {path.name}"):
        grey = cv2.imread(str(pictures[view.name]), cv2.IMREAD_GRAYSCALE)
        assert grey is not None
        for name, estimate in estimators(session.board).items():
            by[name].append(estimate(np.asarray(grey, np.uint8), view.corners))
    return Folder(path, views, by)


def take(folder: Folder, name: str, selected: Sequence[bool], *, weighted: bool) -> None:
    """Make the folder a session of one estimator's corners, all of one weight, or as their own
    covariances weigh them.
    """
    chosen = []
    for view, corners, keep in zip(folder.views, folder.by[name], selected, strict=True):
        if keep and corners is not None:
            chosen.append(
                replace(view, covariance=None)
                if weighted
                else View(view.name, corners, np.ones(len(corners)))
            )
    write_corners(folder.path / "corners.vnl", chosen)
    described = yaml.safe_load((folder.path / "session.yaml").read_text())
    (folder.path / "session.yaml").write_text(
        yaml.safe_dump({**described, "corners": "corners.vnl"})
    )


def judged(path: Path, effects: Sequence[str]) -> tuple[float, float]:
    """Fitted and held out, px RMS."""
    made = with_requested(
        fit(read_session(path), Settings(), Silent()), (*effects, *PATTERN), Silent()
    )
    if (path / "holdout").is_dir():
        return (
            made.stages[-1].rms_px,
            evaluate(made, read_session(path / "holdout"), Silent()).rms_px,
        )
    model, observations = full_model(made), made.observations
    with single_thread():
        joint = model.fit(observations, torch.from_numpy(made.poses))
        held_out = hold_out(model, observations, joint, fold_split(range(len(made.views))))
    return made.stages[-1].rms_px, held_out.rms


def main(session: Path, effects: Sequence[str]) -> None:
    with TemporaryDirectory() as place:
        path = Path(place) / session.name
        shutil.copytree(session, path)
        folders = [measured(piece) for piece in (path, path / "holdout") if piece.is_dir()]
        view_count = sum(len(folder.views) for folder in folders)
        found_counts = {
            name: sum(
                selected_views is not None
                for folder in folders
                for selected_views in folder.by[name]
            )
            for name in folders[0].by
        }
        compared = [name for name, count in found_counts.items() if count >= ENOUGH * view_count]
        selected = [
            [
                all(folder.by[name][view] is not None for name in compared)
                for view in range(len(folder.views))
            ]
            for folder in folders
        ]
        views = " and ".join(str(sum(selected_views)) for selected_views in selected)
        table = Table(
            "corners",
            "fitted, px",
            "held out, px",
            title=f"{session.name}: {views} views that all of them have",
        )
        for name, weighted in track([*((name, False) for name in compared), (OURS, True)], "Fits"):
            for folder, selected_views in zip(folders, selected, strict=True):
                take(folder, name, selected_views, weighted=weighted)
            label = f"{name}, weighted as calib does" if weighted else name
            table.add_row(label, *(f"{px:.4f}" for px in judged(path, effects)))
    Console(width=120).print(table)
    for name in found_counts.keys() - set(compared):
        print(f"{name}: the board in {found_counts[name]} of {view_count} pictures")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:])
