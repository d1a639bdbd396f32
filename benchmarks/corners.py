"""The errors of measured corners, compared with the bound that their pixels set: `python -m
benchmarks.corners [PICTURES]`.

Drawn pictures of known truth, each scene from its reference changed in one way: noise, blur,
contrast, tilt, the size of squares, JPEG, sharpening, uneven light. Errors are over the Cramer-Rao
bound of the noise that was drawn, which knows nothing of a JPEG's own loss or of
sharpening: no estimator reaches 1 there. Every estimator but `findChessboardCornersSB` and
    mrgingham, which is asked where it is installed,
starts from the same places, half a pixel and less beside the truth. A view's bias is the mean of
its corners' errors.
"""

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from calib.corners.detect import SEARCHES, eight_bits, refine
from calib.corners.measure import measure_corners
from calib.io.images import read_grey
from calib.session.board import Board
from calib.session.session import read_session
from fixtures import mrgingham
from fixtures.corner_pictures import Drawn, Scene
from fixtures.corner_scores import drawn, ours, score

Floats = NDArray[np.float64]

REFERENCE = Scene(board=Board(7, 7, 1.0))  # square: mrgingham knows no other boards
FEW = Board(4, 4, 1.0)  # where squares are large
GRID: dict[str, Scene] = {
    "reference": REFERENCE,
    **{f"noise {noise:g}": replace(REFERENCE, noise=noise) for noise in (0.5, 3.0, 8.0)},
    **{f"blur {blur:g} px": replace(REFERENCE, blur=blur) for blur in (0.5, 1.2, 2.5)},
    **{
        f"contrast {contrast:g}": replace(REFERENCE, contrast=contrast) for contrast in (30.0, 80.0)
    },
    **{f"tilt {tilt:g} deg": replace(REFERENCE, tilt=tilt) for tilt in (0.0, 50.0, 65.0)},
    **{
        f"squares of {square:g} px": replace(REFERENCE, square=square)
        for square in (8.0, 12.0, 20.0)
    },
    **{
        f"squares of {square:g} px": replace(REFERENCE, square=square, board=FEW)
        for square in (80.0, 120.0)
    },
    **{f"JPEG {quality}": replace(REFERENCE, jpeg=quality) for quality in (100, 95, 90, 80)},
    **{f"sharpened by {amount:g}": replace(REFERENCE, sharpening=amount) for amount in (0.7, 1.5)},
    "sharpened by 1, JPEG 90": replace(REFERENCE, sharpening=1.0, jpeg=90),
    **{
        f"light uneven by {part:g}": replace(REFERENCE, contrast=120.0, uneven=part)
        for part in (0.2, 0.4)
    },
}
BUMPS = Path(__file__).parents[1] / "fixtures" / "bumps"
WINDOWS = (3, 6, 11)  # px, cornerSubPix's half-sizes
LIMIT = 3.0  # px: a corner further off is none


def _others(scene: Scene) -> Iterator[tuple[str, Callable[[Drawn, Floats], Floats | None]]]:
    yield "cornerSubPix, enlarged", lambda drawn, start: refine(drawn.picture, start, scene.board)
    for name, flags in (
        ("SB", 0),
        ("SB, ACCURACY", cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE),
    ):
        yield name, lambda drawn, _, flags=flags: _sectors(drawn, scene.board, flags)  # type: ignore[misc]
    for half in WINDOWS:
        yield f"cornerSubPix {half}", lambda drawn, start, half=half: _sub_pixel(drawn, start, half)  # type: ignore[misc]
    if mrgingham.can_find(scene.board):
        for method in mrgingham.WAYS:
            find = partial(mrgingham.find, board=scene.board, method=method)
            yield method, lambda drawn, _, find=find: _near(find(drawn.picture), drawn)  # type: ignore[misc]


def _sectors(drawn: Drawn, board: Board, flags: int) -> Floats | None:
    is_found, corners = cv2.findChessboardCornersSB(
        drawn.picture, (board.columns, board.rows), flags=flags
    )
    return _near(np.asarray(corners, np.float64).reshape(-1, 2), drawn) if is_found else None


def _near(estimate: Floats | None, drawn: Drawn) -> Floats | None:
    """(count, 2) px in the order of the truth; None where a corner has none."""
    expected = None if estimate is None else mrgingham.nearest(estimate, drawn.corners)
    return (
        expected
        if expected is not None and np.linalg.norm(expected - drawn.corners, axis=1).max() < LIMIT
        else None
    )


def _sub_pixel(drawn: Drawn, start: Floats, half: int) -> Floats:
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-3)
    corners = cv2.cornerSubPix(
        drawn.picture, start.reshape(-1, 1, 2).astype(np.float32), (half, half), (-1, -1), stop
    )
    return np.asarray(corners, np.float64).reshape(-1, 2)


def main(pictures: int = 6) -> None:
    names = [name for name, _ in _others(REFERENCE)]
    table = Table(
        "scene",
        "bound, px",
        "ours",
        "bias, px",
        "squared error over predicted",
        *names,
        title="RMS error over the bound",
    )
    all_ours, best = [], []
    for number, (name, scene) in enumerate(GRID.items()):
        shown = drawn(scene, pictures, number)
        bounds = np.stack([drawn.bounds for drawn, _ in shown])
        expected = ours(scene, shown)
        scores = [_scored(measured, shown, bounds) for _, measured in _others(scene)]
        bound = float(np.sqrt(np.trace(bounds, axis1=2, axis2=3).mean()))
        cells = [_said(*other_score, pictures) for other_score in scores]
        table.add_row(
            name,
            f"{bound:.4f}",
            f"{expected.over_bound:.2f}",
            f"{expected.bias:.4f}",
            f"{expected.over_predicted:.2f}",
            *cells,
        )
        all_ours.append(expected)
        best.append(np.nanmin([over for over, _ in scores[1:]]))
    predicted = [score.over_predicted for score in all_ours]
    over_bound = [score.over_bound for score in all_ours]
    over_best = [
        our_score / best_other for our_score, best_other in zip(over_bound, best, strict=True)
    ]
    Console(width=180).print(table)
    print(
        f"median over the bound {median(over_bound):.2f}; worst bias"
        f" {max(score.bias for score in all_ours):.4f} px; squared error over predicted"
        f" {min(predicted):.2f} to {max(predicted):.2f}; most over the best other"
        f" {max(over_best):.2f}"
    )
    _speed()


def _scored(
    measured: Callable[[Drawn, Floats], Floats | None],
    shown: list[tuple[Drawn, Floats]],
    bounds: Floats,
) -> tuple[float, int]:
    """The error over the bound in the pictures in which the board was found, and how many these
    are.
    """
    results = [measured(drawn, start) for drawn, start in shown]
    errors = [
        row - drawn.corners
        for row, (drawn, _) in zip(results, shown, strict=True)
        if row is not None
    ]
    return (
        score(np.stack(errors), bounds[[row is not None for row in results]]).over_bound
        if errors
        else float("nan")
    ), len(errors)


def _said(over: float, count: int, pictures: int) -> str:
    return (
        f"{over:.2f}" + (f" ({count} of {pictures})" if count < pictures else "")
        if count
        else "not found"
    )


def _speed() -> None:
    """Print the speed for views through a cover: of the search for a board, by saddles and by SB,
    and of the steps that follow.
    """
    session = read_session(BUMPS)
    board, (saddles, sectors) = session.board, [search for _, search in SEARCHES[:2]]
    pictures = [eight_bits(read_grey(path)) for path in session.frames]
    shown = [(picture, rough.corners) for picture in pictures if (rough := saddles(picture, board))]
    steps: dict[str, Callable[[NDArray[np.uint8], Floats], object]] = {
        "found by saddles": lambda picture, _: saddles(picture, board),
        "found by SB": lambda picture, _: sectors(picture, board),
        "refined": lambda picture, corners: refine(picture, corners, board),
        "measured": lambda picture, corners: measure_corners(picture, corners, board),
    }
    for name, work in steps.items():
        spent = []
        for picture, corners in shown:
            near = refine(picture, corners, board) if name == "measured" else corners
            start_time = time.perf_counter()
            work(picture, near)
            spent.append(1e3 * (time.perf_counter() - start_time))
        print(f"{len(shown)} views of fixtures/bumps, {name}: {median(spent):.1f} ms a view")


if __name__ == "__main__":
    main(*(int(argument) for argument in sys.argv[1:2]))
