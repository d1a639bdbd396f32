"""`calib fit` against other programs on measured sessions without a cover, on the same corners.

Every third view is kept back. Each program calibrates with the others, and each of its kept-back
views gets the pose that suits it best; the error is the root mean square of all corners there, px.
mrcal estimates the board's warp, and is left out where /usr/bin/python3 does not have it.

    python -m benchmarks.measured_sets SESSION...
"""

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import yaml
from rich.console import Console
from rich.table import Table

from calib.corners.corners_file import write_corners
from calib.corners.view import View
from calib.fit_record.request import Settings
from calib.fitting.evaluate import evaluate
from calib.fitting.fit import fit
from calib.fitting.inputs import read_views
from calib.progress import Silent
from calib.session.session import Session, read_session

KEPT_BACK = 3
"""Every view of this number is kept back."""
PYTHON = "/usr/bin/python3"
PEERS = Path(__file__).parents[1]
OPENCV = {
    "OpenCV 5": 0,
    "OpenCV 8": cv2.CALIB_RATIONAL_MODEL,
}


def main() -> None:
    folders = list(map(Path, sys.argv[1:]))
    if not folders:
        raise SystemExit(__doc__)
    table = Table("session", "calib fit", "flat board", "best other", "ratio", "CPU s", "others")
    ratios = []
    for folder in folders:
        with TemporaryDirectory() as temporary:
            kept, held_out = split(folder, Path(temporary))
            start = time.process_time()
            ours = evaluate(fit(kept), held_out).rms_px
            seconds = time.process_time() - start
            flat = evaluate(fit(kept, Settings(flat_board=True)), held_out).rms_px
            others = dict(peers(kept, held_out))
        best = min(others.values())
        ratios.append(ours / best)
        table.add_row(
            str(folder),
            f"{ours:.4f}",
            f"{flat:.4f}",
            f"{best:.4f}",
            f"{ratios[-1]:.2f}",
            f"{seconds:.1f}",
            ", ".join(f"{name} {error:.4f}" for name, error in others.items()),
        )
    console = Console(width=200)
    console.print(table)
    console.print(
        f"ratio to the best other: median {np.median(ratios):.2f}, most {max(ratios):.2f}"
    )


def split(folder: Path, out: Path) -> tuple[Session, Session]:
    """Return the session without its kept-back views, and a session of these."""
    session = read_session(folder)
    views, _ = read_views(session, Silent())
    document = yaml.safe_load((folder / "session.yaml").read_text())
    document["corners"] = "corners.vnl"
    parts: dict[str, list[View]] = {"kept": [], "held_out": []}
    for index, view in enumerate(views):
        parts["held_out" if index % KEPT_BACK == KEPT_BACK - 1 else "kept"].append(view)
    for name, part in parts.items():
        (out / name).mkdir()
        (out / name / "session.yaml").write_text(yaml.safe_dump(document))
        write_corners(out / name / "corners.vnl", part)
    return read_session(out / "kept"), read_session(out / "held_out")


def peers(kept: Session, held_out: Session) -> Iterator[tuple[str, float]]:
    """Yield the name of each other program and its error on the kept-back views, px."""
    fitted, _ = read_views(kept, Silent())
    scored, _ = read_views(held_out, Silent())
    board = kept.board
    points = np.column_stack([board.points(), np.zeros(board.count)]).astype(np.float32)
    size = kept.camera.width, kept.camera.height
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
        squares = []
        for view in scored:
            seen = points[view.seen].astype(np.float64)
            _, turn, place = cv2.solvePnP(seen, view.corners[view.seen], matrix, lens)
            image = cv2.projectPoints(seen, turn, place, matrix, lens)[0].reshape(-1, 2)
            squares.append(((image - view.corners[view.seen]) ** 2).sum(-1))
        yield name, float(np.sqrt(np.concatenate(squares).mean()))
    child = subprocess.run(
        [PYTHON, "-m", "benchmarks.peers.mrcal_session", str(kept.path), str(held_out.path)],
        cwd=PEERS,
        capture_output=True,
        text=True,
        check=False,
    )
    if child.returncode == 0:
        yield from json.loads(child.stdout).items()


if __name__ == "__main__":
    main()
