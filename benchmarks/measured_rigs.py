"""`calib rig fit` against mrcal's joint fit on measured pairs of cameras, on the same corners:

    python -m benchmarks.measured_rigs [PAIR...]

A pair is a folder with two sessions, `left` and `right`, whose pictures of the same name were taken
at the same time. Without a folder, those of ../shared/data are measured. Every third placement that
both cameras saw is kept back, and each program fits the others. Then the board gets a pose in each
kept-back placement, which is the same for both cameras, and everything else stays. The errors are
two-dimensional root mean squares of the corners, px, and all programs are measured by the same
code (`fixtures.rig_score`).

- rig fit: both cameras and the board together; flat board: the same without a bend and a print.
- by itself: each camera's fit, with the board's shape and print as it alone finds them, and the
  mounting that fits the fitted placements best. One board: the same cameras, with the board's shape
  and print of the rig fit.
- mrcal: both cameras and the board's warp together, by mrcal-calibrate-cameras. It is left out
  where /usr/bin/python3 does not have it.
- crosswise: each half of the corners is measured with the pose that the other half gives.
- alike: the correlation of both cameras' errors at the same corners. What the board does in one
  placement (it bends, it moves during the readout) shows in both cameras alike.
- median: that of the errors of the placements.
- ratio: the error over that of the rig fit, and its 95 % interval by drawing the kept-back
  placements anew; worse: in how many of them the error is larger.

With --thirds, each third of the shared placements is kept back in turn, and the errors of all three
are taken together.

With --diagnosed, the rig fit is diagnosed as well. Its board may have a bend of its own in each
kept-back placement, which could hide the error. So its error is the one measured crosswise, and the
ratios are those of the errors measured crosswise, for all programs.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch
import yaml
from rich.console import Console
from rich.table import Table

from benchmarks.measured_sets import PEERS, PYTHON, THIRDS, part_of, ratio_interval
from calib.calibration import Calibration
from calib.corners.view import View
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.fitting.inputs import read_views
from calib.optics.exposure import MIDDLE
from calib.progress import Silent
from calib.rig.diagnose_rig import diagnose_rig
from calib.rig.evaluate_rig import evaluate_rig
from calib.rig.fit_rig import fit_rig
from calib.rig.mounting_start import start_rig, turn_view
from calib.rig.placements import Placements
from calib.rig.rig import Rig
from calib.rig.rig_file import NAME as RIG_FILE
from calib.rig.rig_file import read_rig
from calib.session.session import read_session
from fixtures.rig_score import (
    Floats,
    PlacedCamera,
    Score,
    score,
    shared_corners,
    shared_names,
    with_best_mounting,
)

DATA = Path(__file__).parents[2] / "shared" / "data"
PAIRS = ("stereo-air", "stereo-water")
NAMES = ("left", "right")
"""The folders of a pair; the first camera is the reference."""
FLAT = Settings(flat_board=True)


@dataclass(frozen=True, slots=True)
class Row:
    """The result of one program."""

    title: str
    score: Score
    baseline: float
    """m"""
    seconds: float
    """CPU time of the fit."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("pairs", nargs="*", type=Path, metavar="PAIR")
    parser.add_argument("--thirds", action="store_true", help="keep back each third in turn")
    parser.add_argument("--diagnosed", action="store_true", help="diagnose the rig fit as well")
    options = parser.parse_args()
    pairs = options.pairs or [DATA / name for name in PAIRS]
    remainders = range(THIRDS) if options.thirds else (THIRDS - 1,)
    console = Console(width=140)
    for pair in pairs:
        if not (pair / NAMES[0]).is_dir():
            console.print(f"{pair} is not there: name folders with the sessions left and right.")
            continue
        views = views_in_one_order(pair)
        rounds = []
        for remainder in remainders:
            with TemporaryDirectory() as temporary:
                fitted, held_out = split_pair(pair, views, remainder, Path(temporary))
                rows = [*measure_ours(fitted, held_out), *measure_mrcal(fitted, held_out)]
                if options.diagnosed:
                    rows.append(measure_diagnosed(fitted, held_out, console))
                rounds.append(rows)
        joined = [_join(rows) for rows in zip(*rounds, strict=True)]
        console.print(_table(pair.name, joined, is_crosswise=options.diagnosed))


def views_in_one_order(pair: Path) -> dict[str, list[View]]:
    """Return the views of each camera, with their corners in the order of the same board."""
    calibrations = {name: fit(pair / name) for name in NAMES}
    fitted = {name: calibration.views for name, calibration in calibrations.items()}
    with TemporaryDirectory() as folder:
        _describe(Path(folder), {name: str((pair / name).resolve()) for name in NAMES})
        placements = Placements.of(read_rig(folder), fitted)
    poses = {name: torch.from_numpy(c.poses[:, :6]) for name, c in calibrations.items()}
    board = calibrations[NAMES[0]].board
    turns = start_rig(poses, placements, NAMES[0], board).turns
    ordered = {}
    for name in NAMES:
        of_view = {
            view.name: int(turn) for view, turn in zip(fitted[name], turns[name], strict=True)
        }
        views, _ = read_views(read_session(pair / name), Silent())
        ordered[name] = [turn_view(view, board, of_view.get(view.name, 0)) for view in views]
    return ordered


def split_pair(
    pair: Path, views: Mapping[str, Sequence[View]], remainder: int, out: Path
) -> tuple[Path, Path]:
    """Return the folders of a pair without its kept-back placements, and of these.

    Args:
        pair: the folder with the sessions.
        views: the views of each camera.
        remainder: the first shared placement that is kept back, 0 to 2.
        out: the folder for both.
    """
    shared = shared_names([{view.name: view for view in views[name]} for name in NAMES])
    kept_back = set(shared[remainder::THIRDS])
    folders = out / "fitted", out / "held_out"
    for folder, is_held_out in zip(folders, (False, True), strict=True):
        folder.mkdir()
        for name in NAMES:
            chosen = [view for view in views[name] if (view.name in kept_back) is is_held_out]
            part_of(pair / name, chosen, folder / name)
        _describe(folder)
    return folders


def measure_ours(fitted: Path, held_out: Path) -> Iterator[Row]:
    """Yield the results of `calib rig fit` and of each camera's own fit."""
    corners = shared_corners({name: held_out / name / "corners.vnl" for name in NAMES})
    start = time.process_time()
    rig = fit_rig(fitted)
    seconds = time.process_time() - start
    together = rig_cameras(rig)
    yield _row("rig fit", together, corners, seconds)
    start = time.process_time()
    flat = fit_rig(fitted, FLAT)
    seconds = time.process_time() - start
    yield _row("rig fit, flat board", rig_cameras(flat), corners, seconds)
    start = time.process_time()
    calibrations = {name: fit(fitted / name) for name in NAMES}
    seconds = time.process_time() - start
    alone = {
        name: PlacedCamera(calibration.project, together[name].mounting, board_points(calibration))
        for name, calibration in calibrations.items()
    }
    fitted_corners = shared_corners({name: fitted / name / "corners.vnl" for name in NAMES})
    of_rig = {
        name: PlacedCamera(camera.project, camera.mounting, together[name].board)
        for name, camera in alone.items()
    }
    for title, cameras in (("by itself", alone), ("by itself, one board", of_rig)):
        mounted = with_best_mounting(cameras, NAMES[1], fitted_corners)
        yield _row(title, mounted, corners, seconds)


def measure_diagnosed(fitted: Path, held_out: Path, console: Console) -> Row:
    """Return the result of `calib rig diagnose`, and print what it finds."""
    start = time.process_time()
    rig, diagnosis = diagnose_rig(fit_rig(fitted))
    seconds = time.process_time() - start
    console.print(f"found: {', '.join(diagnosis.accepted) or 'nothing'}")
    views: dict[str, dict[str, View]] = {}
    for name in NAMES:
        sessions, _ = read_views(read_session(held_out / name), Silent())
        views[name] = {view.name: view for view in sessions}
    corners: dict[str, list[int]] = {name: [] for name in NAMES}
    squares: dict[str, list[float]] = {name: [] for name in NAMES}
    for picture in shared_names(list(views.values())):
        with TemporaryDirectory() as temporary:
            for name in NAMES:
                part_of(held_out / name, [views[name][picture]], Path(temporary, name))
            _describe(Path(temporary))
            evaluation = evaluate_rig(rig, temporary, halves=True)
        for name, error in evaluation.cameras.items():
            count = int(views[name][picture].seen.sum())
            corners[name].append(count)
            squares[name].append(error**2 * count)
    measured = Score(
        corners={name: np.array(counts) for name, counts in corners.items()},
        squares={name: np.array(sums) for name, sums in squares.items()},
        products=np.full(len(corners[NAMES[0]]), np.nan),
        crossed=np.sum(list(squares.values()), 0),
    )
    baseline = float(np.linalg.norm(rig.mountings[1, 3:]))
    return Row("rig diagnose", measured, baseline, seconds)


def measure_mrcal(fitted: Path, held_out: Path) -> Iterator[Row]:
    """Yield the results of mrcal's joint fits; none where it is not installed."""
    child = subprocess.run(
        [PYTHON, "-m", "benchmarks.peers.mrcal_rig", str(fitted), str(held_out)],
        cwd=PEERS,
        capture_output=True,
        text=True,
        check=False,
    )
    if child.returncode:
        return
    for title, result in json.loads(child.stdout).items():
        measured = Score.of_document(result["score"])
        yield Row(title, measured, result["baseline"], result["seconds"])


def rig_cameras(rig: Rig) -> dict[str, PlacedCamera]:
    """Return the cameras of a rig."""
    return {
        name: PlacedCamera(calibration.project, mounting, board_points(calibration))
        for (name, calibration), mounting in zip(
            rig.calibrations.items(), rig.mountings, strict=True
        )
    }


def board_points(calibration: Calibration) -> Floats:
    """Return the (B, 3) m corners of the board with its shape and print, in its own frame."""
    path, values = calibration.model()
    corners = torch.from_numpy(calibration.board.points())
    poses = torch.zeros(len(corners), 6, dtype=torch.float64)
    return path.place(corners, values, poses, MIDDLE).numpy()


def _describe(folder: Path, sessions: Mapping[str, str] | None = None) -> None:
    """Write the rig.yaml of a pair."""
    document = {
        "format": 1,
        "cameras": sessions or {name: name for name in NAMES},
        "reference": NAMES[0],
        "together": "by_name",
    }
    (folder / RIG_FILE).write_text(yaml.safe_dump(document))


def _row(
    title: str, cameras: Mapping[str, PlacedCamera], corners: Mapping[str, Floats], seconds: float
) -> Row:
    baseline = float(np.linalg.norm(cameras[NAMES[1]].mounting[3:]))
    return Row(title, score(cameras, corners), baseline, seconds)


def _join(rows: Sequence[Row]) -> Row:
    """Return the result of one program over several rounds, with the mean baseline and time."""
    return Row(
        rows[0].title,
        Score.join([row.score for row in rows]),
        float(np.mean([row.baseline for row in rows])),
        float(np.mean([row.seconds for row in rows])),
    )


def _table(pair: str, rows: Sequence[Row], *, is_crosswise: bool) -> Table:
    """Return the table of a pair.

    Args:
        is_crosswise: take the ratios from the errors that are measured crosswise.
    """
    rig = rows[0].score
    table = Table(title=f"{pair}: {len(rig.crossed)} placements kept back")
    table.add_column("")
    columns = (
        "px",
        *NAMES,
        "crosswise",
        "alike",
        "median",
        "ratio",
        "worse",
        "baseline, mm",
        "CPU s",
    )
    for column in columns:
        table.add_column(column, justify="right")
    for row in rows:
        sums = [s.crossed if is_crosswise else s.total for s in (row.score, rig)]
        ratio = np.sqrt(sums[0].sum() / sums[1].sum())
        low, high = ratio_interval(*sums)
        table.add_row(
            row.title,
            f"{row.score.rms_px:.4f}",
            *(f"{row.score.of_camera(name):.4f}" for name in NAMES),
            f"{row.score.crossed_px:.4f}",
            f"{row.score.correlation:.2f}",
            f"{np.median(row.score.by_placement):.4f}",
            f"{ratio:.2f} ({low:.2f} to {high:.2f})",
            str(int((sums[0] > sums[1]).sum())),
            f"{1000 * row.baseline:.2f}",
            f"{row.seconds:.1f}",
        )
    return table


if __name__ == "__main__":
    main()
