"""`calib fit` against other programs on measured sessions without a cover, on the same corners.

Every third view is kept back, without its single corners at wrong places
(`calib.fitting.corner_outliers`). Each program calibrates with the others, and each of its
kept-back views gets the pose that suits it best; the error is the root mean square of all corners
there, px.
"Ratio" is to the best other program, with its 95 % interval by drawing the kept-back views anew.
"Noise" is that of single corners, over the error of the best other program: no model can be better.
mrcal estimates the board's warp, and is left out where /usr/bin/python3 does not have it.

    python -m benchmarks.measured_sets SESSION...

--third 0 and --third 1 keep back the other views, on which decisions are made.

With --halves, two halves of the views are fitted instead, even against odd and first against last:
by how many of their standard deviations do fx, fy, cx and cy differ?

    python -m benchmarks.measured_sets --halves SESSION...

With --diagnosed, ours is the result of `calib diagnose`, and what it found is printed. What differs
from view to view has numbers in every kept-back view, which could hide its error: so each half of a
view's corners is measured with the pose and the numbers that the other half gives, in all programs.
"""

import argparse
import json
import subprocess
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import torch
import yaml
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from calib.calibration import Calibration
from calib.corners.corners_file import write_corners
from calib.corners.view import View
from calib.diagnosis.diagnose import diagnose
from calib.diagnosis.finding import Diagnosis
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refit_poses
from calib.fit_record.request import Settings
from calib.fitting.corner_outliers import find_outlier_corners, without_corners
from calib.fitting.evaluate import evaluate
from calib.fitting.fit import fit
from calib.fitting.inputs import read_views
from calib.inference.calibration_model import full_model
from calib.progress import Silent
from calib.session.parameter_names import CAMERA
from calib.session.session import Session, read_session

Floats = NDArray[np.float64]
DRAWS = 4000
"""Draws for an interval."""
THIRDS = 3
"""One of so many parts of the views is kept back."""
PYTHON = "/usr/bin/python3"
PEERS = Path(__file__).parents[1]
OPENCV = {
    "OpenCV 5": 0,
    "OpenCV 8": cv2.CALIB_RATIONAL_MODEL,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("sessions", nargs="+", type=Path)
    parser.add_argument("--halves", action="store_true")
    parser.add_argument("--diagnosed", action="store_true")
    parser.add_argument(
        "--third",
        type=int,
        choices=range(THIRDS),
        default=THIRDS - 1,
        help="the first view that is kept back (default: 2)",
    )
    args = parser.parse_args()
    if args.halves:
        compare_halves(args.sessions, diagnosed=args.diagnosed)
    else:
        compare_peers(args.sessions, args.third, diagnosed=args.diagnosed)


def compare_peers(folders: Sequence[Path], first: int, *, diagnosed: bool) -> None:
    """Print the errors on the kept-back views, and the ratio to the best other program.

    Args:
        folders: the sessions.
        first: the first view that is kept back, and every third from there on.
        diagnosed: True to diagnose our fit.
    """
    table = Table(
        *(
            "session",
            "ours",
            "flat board",
            "best other",
            "ratio",
            "noise",
            "CPU s",
            "wrong corners",
        ),
        "others",
        "found",
    )
    ratios, floors = [], []
    console = Console(width=200)
    for folder in folders:
        with TemporaryDirectory() as temporary:
            training, held_out = split(folder, first, Path(temporary))
            start = time.process_time()
            calibration = fit(training)
            held_out, wrong = without_wrong_corners(held_out, calibration, Path(temporary, "right"))
            causes = ""
            if diagnosed:
                calibration, diagnosis = diagnose(calibration)
                causes = names(diagnosis)
            seconds = time.process_time() - start
            floor = calibration.noise_px or np.nan
            views, _ = read_views(held_out, Silent())
            squares = {
                view.name: _sum_of_squares(calibration, folder, view, halves=diagnosed)
                for view in views
            }
            without_bend = fit(training, Settings(flat_board=True))
            flat = evaluate(without_bend, held_out, halves=diagnosed).rms_px
            peer_squares = dict(peers(training, held_out, halves=diagnosed))
        count = sum(int(view.seen.sum()) for view in views)
        ours = _root_mean(squares, count)
        peer_errors = {name: _root_mean(by_view, count) for name, by_view in peer_squares.items()}
        best_name = min(peer_errors, key=peer_errors.__getitem__)
        best = peer_errors[best_name]
        paired = [(square, peer_squares[best_name][name]) for name, square in squares.items()]
        low, high = ratio_interval(*np.array(paired).T)
        ratios.append(ours / best)
        floors.append(floor / best)
        table.add_row(
            str(folder),
            f"{ours:.4f}",
            f"{flat:.4f}",
            f"{best:.4f}",
            f"{ratios[-1]:.2f} ({low:.2f} to {high:.2f})",
            f"{floors[-1]:.2f}",
            f"{seconds:.1f}",
            str(wrong),
            ", ".join(f"{name} {error:.4f}" for name, error in peer_errors.items()),
            causes,
        )
    console.print(table)
    console.print(
        f"ratio to the best other: median {np.median(ratios):.2f}, most {max(ratios):.2f}; of the"
        f" noise of single corners: median {np.nanmedian(floors):.2f}, most {np.nanmax(floors):.2f}"
    )


def _sum_of_squares(calibration: Calibration, folder: Path, view: View, *, halves: bool) -> float:
    """Return the sum of a view's squared errors, px^2."""
    with TemporaryDirectory() as temporary:
        alone = part_of(folder, [view], Path(temporary, "view"))
        return evaluate(calibration, alone, halves=halves).rms_px ** 2 * int(view.seen.sum())


def _root_mean(by_view: Mapping[str, float], count: int) -> float:
    """Return the root mean square of the views' errors; count: their corners."""
    return float(np.sqrt(sum(by_view.values()) / count))


def ratio_interval(first: Floats, second: Floats) -> tuple[float, float]:
    """Return the 95 % interval of the ratio of two errors, by drawing the views anew.

    Args:
        first, second: (V,) each view's sum of squared errors.
    """
    count = len(first)
    draws = np.random.default_rng(0).integers(0, count, (DRAWS, count))
    ratios = np.sqrt(first[draws].sum(-1) / second[draws].sum(-1))
    low, high = np.quantile(ratios, [0.025, 0.975])
    return float(low), float(high)


def names(diagnosis: Diagnosis) -> str:
    """Return the accepted effects, with the families that the views cannot tell apart."""
    return "; ".join(
        (*diagnosis.accepted, *(" or ".join(family.members) for family in diagnosis.families))
    )


def split(folder: Path, first: int, out: Path) -> tuple[Session, Session]:
    """Return the session without its kept-back views, and a session of these."""
    views, _ = read_views(read_session(folder), Silent())
    training = [view for index, view in enumerate(views) if index % THIRDS != first]
    held_out = views[first::THIRDS]
    return part_of(folder, training, out / "kept"), part_of(folder, held_out, out / "held_out")


def without_wrong_corners(
    session: Session, calibration: Calibration, out: Path
) -> tuple[Session, int]:
    """Return the session without corners at wrong places, which would be most of every program's
    error, and their number.
    """
    views, _ = read_views(session, Silent())
    path, values = calibration.model()
    observations = Observations.of(views, session.board)
    start = pinhole_poses(path, values, observations)
    _, residual = refit_poses(path, values, observations, start)
    wrong = find_outlier_corners(views, residual, session.board, session.camera)
    return part_of(session.path, without_corners(views, wrong), out), int(wrong.sum())


def part_of(folder: Path, views: Sequence[View], out: Path) -> Session:
    """Return a session of some of a session's views."""
    document = yaml.safe_load((folder / "session.yaml").read_text())
    document["corners"] = "corners.vnl"
    out.mkdir()
    (out / "session.yaml").write_text(yaml.safe_dump(document))
    write_corners(out / "corners.vnl", views)
    return read_session(out)


def compare_halves(folders: Sequence[Path], *, diagnosed: bool) -> None:
    """Print the differences of the halves of each session, and their root mean square."""
    table = Table("session", "halves", "by views: fx, fy, cx, cy", "by corners", "found")
    console = Console(width=200)
    squares: dict[str, list[tuple[float, float]]] = {}
    for folder in folders:
        views, _ = read_views(read_session(folder), Silent())
        middle = len(views) // 2
        for words, halves in (
            ("even, odd", (views[::2], views[1::2])),
            ("first, last", (views[:middle], views[middle:])),
        ):
            numbers, causes = [], []
            for half in halves:
                with TemporaryDirectory() as temporary:
                    calibration = fit(part_of(folder, half, Path(temporary, "half")))
                if diagnosed:
                    calibration, diagnosis = diagnose(calibration)
                    causes.append(names(diagnosis))
                numbers.append(pinhole(calibration))
            first, second = numbers
            difference = first[0] - second[0]
            by_views, by_corners = difference / np.hypot(first[1:], second[1:])
            squares.setdefault(words, []).extend(zip(by_views**2, by_corners**2, strict=True))
            console.print(folder.name, words, by_views.round(1), causes)
            table.add_row(
                str(folder),
                words,
                str(by_views.round(1)),
                str(by_corners.round(1)),
                " | ".join(causes),
            )
    console.print(table)
    for words, pairs in squares.items():
        by_views, by_corners = np.sqrt(np.mean(pairs, 0))
        console.print(f"{words}: rms {by_views:.2f} by views, {by_corners:.2f} by corners")


def pinhole(calibration: Calibration) -> Floats:
    """Return (3, 4): fx, fy, cx and cy, their standard deviations by views, and by corners."""
    intrinsics = calibration.camera.intrinsics
    assert intrinsics
    numbers = [getattr(intrinsics, name) for name in ("fx", "fy", "cx", "cy")]
    joint = full_model(calibration).fit(
        calibration.observations, torch.from_numpy(calibration.poses)
    )
    by_corners = [float(joint.sigma_of(name)) for name in CAMERA.pinhole]
    return np.array([[n.value for n in numbers], [n.sigma for n in numbers], by_corners])


def peers(
    training: Session, held_out: Session, *, halves: bool
) -> Iterator[tuple[str, dict[str, float]]]:
    """Yield the name of each other program, and the sum of the squared errors of each kept-back
    view, px^2.
    """
    fitted, _ = read_views(training, Silent())
    scored, _ = read_views(held_out, Silent())
    board = training.board
    points = np.column_stack([board.points(), np.zeros(board.count)]).astype(np.float32)
    size = training.camera.width, training.camera.height
    for name, flags in OPENCV.items():
        try:
            _, matrix, lens, *_ = cv2.calibrateCamera(
                [points[view.seen] for view in fitted],
                [view.corners[view.seen].astype(np.float32) for view in fitted],
                size,
                np.eye(3),
                np.zeros(14),
                flags=flags,
            )
        except cv2.error:
            continue
        squares = {}
        for view in scored:
            seen, corners = points[view.seen].astype(np.float64), view.corners[view.seen]
            odd = np.arange(len(seen)) % 2 == 1
            squares[view.name] = 0.0
            for part in (odd, ~odd) if halves else (odd | True,):
                rest = ~part if halves else part
                _, turn, place = cv2.solvePnP(seen[rest], corners[rest], matrix, lens)
                image = cv2.projectPoints(seen[part], turn, place, matrix, lens)[0]
                squares[view.name] += float(((image.reshape(-1, 2) - corners[part]) ** 2).sum())
        yield name, squares
    child = subprocess.run(
        [
            *(PYTHON, "-m", "benchmarks.peers.mrcal_session"),
            *(str(training.path), str(held_out.path)),
            *(["--halves"] if halves else []),
        ],
        cwd=PEERS,
        capture_output=True,
        text=True,
        check=False,
    )
    if child.returncode == 0:
        yield from json.loads(child.stdout).items()


if __name__ == "__main__":
    main()
