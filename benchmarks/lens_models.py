"""Lens models on sessions without a cover: the error on held-out views of each, before any
diagnosis.

Four folds over the views; a held-out view's pose is fitted to its corners. `all` is the root mean
square over views; `choice` is what `camera.lens: auto` compares, the mean over views of which none
counts for more than four times the median.

    python -m benchmarks.lens_models SESSION... [--every N]
"""

import argparse
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from calib.corners.pose_requirements import split_usable_views
from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.fitting.inputs import read_views
from calib.intrinsics.held_out_views import LensModelFit, clipped_mean, held_out_errors
from calib.intrinsics.opencv_lens import fit_opencv
from calib.intrinsics.ray_lens import PLAIN, SPLINES, RayLens
from calib.intrinsics.ray_lens_fit import LensFit, fit_lens
from calib.progress import Silent
from calib.session.board import Board
from calib.session.session import read_session

COUNTS = (5, 8, 12)
Size = tuple[int, int]


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("sessions", nargs="+", type=Path)
    parser.add_argument(
        "--every", type=int, default=1, metavar="N", help="take each N-th view (default: all)"
    )
    args = parser.parse_args()
    table = Table("session", "views", "lens", "choice, px", "all, px", "CPU s")
    for folder in args.sessions:
        session = read_session(folder)
        views = split_usable_views(read_views(session, Silent())[0], session.board)[0][
            :: args.every
        ]
        size = session.camera.width, session.camera.height
        for name, choice, rms, seconds in _rows(views, session.board, size):
            table.add_row(
                folder.name, str(len(views)), name, f"{choice:.4f}", f"{rms:.4f}", f"{seconds:.0f}"
            )
    Console(width=100).print(table)


def _rows(views: Sequence[View], board: Board, size: Size) -> list[tuple[str, float, float, float]]:
    rows = []
    plain: dict[int, LensFit] = {}
    lenses: tuple[RayLens | int, ...] = (*COUNTS, PLAIN, *SPLINES)
    for lens in lenses:
        start_time = time.process_time()
        try:
            errors = held_out_errors(views, board, partial(_fit, lens, plain, board, size))
        except NotEnoughDataError:
            errors = np.full(len(views), np.nan)
        name = str(lens) if isinstance(lens, RayLens) else f"opencv {lens}"
        rows.append(
            (
                name,
                clipped_mean(errors),
                float(np.sqrt(np.mean(errors**2))),
                time.process_time() - start_time,
            )
        )
    return rows


def _fit(
    lens: RayLens | int,
    plain: dict[int, LensFit],
    board: Board,
    size: Size,
    views: Sequence[View],
    fold: int,
) -> LensModelFit:
    if isinstance(lens, int):
        return fit_opencv(views, board, size, lens)
    if fold not in plain:
        plain[fold] = fit_lens(PLAIN, views, board, size)
    return plain[fold] if lens == PLAIN else fit_lens(lens, views, board, size, plain[fold])


if __name__ == "__main__":
    main()
