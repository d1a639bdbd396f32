"""Debian's mrcal on a pair of sessions of corners: print its score on kept-back placements as JSON.

Run by /usr/bin/python3, where Debian puts mrcal: FITTED HELD_OUT, two folders with the sessions
`left` and `right`. mrcal fits both cameras, the board's poses and its warp together.
"""

import contextlib
import json
import math
import runpy
import shutil
import sys
import tempfile
import time
from pathlib import Path

import mrcal  # type: ignore[import-not-found]
import numpy as np
import yaml

from benchmarks.peers.mrcal_session import MARGIN, MAX_FIELD, OPENCV8, SPLINED, command_words
from fixtures.rig_score import Floats, PlacedCamera, read_corners, score, shared_corners

COMMAND = "mrcal-calibrate-cameras"
NAMES = ("left", "right")


def main() -> None:
    fitted, held_out = map(Path, sys.argv[1:3])
    corners = shared_corners({name: held_out / name / "corners.vnl" for name in NAMES})
    width = yaml.safe_load((fitted / NAMES[0] / "session.yaml").read_text())["camera"]["width"]
    results = {}
    focal = float(width)
    for title, model in (("mrcal OPENCV8", OPENCV8), ("mrcal splined", SPLINED)):
        field = MARGIN * 2 * math.degrees(math.atan(width / 2 / focal))
        lens = model.format(min(MAX_FIELD, int(field)))
        np.random.seed(0)  # noqa: NPY002  the command starts lenses with draws of this generator
        start = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            inputs = calibrate(fitted, lens, focal, Path(folder))
        seconds = time.process_time() - start
        focal = float(inputs["intrinsics"][:, 0].min())
        cameras = placed_cameras(inputs)
        results[title] = {
            "score": score(cameras, corners).document(),
            "baseline": float(np.linalg.norm(cameras[NAMES[1]].mounting[3:])),
            "seconds": seconds,
        }
    print(json.dumps(results))


def calibrate(session: Path, model: str, focal: float, folder: Path) -> dict[str, Floats]:
    """Return the solution of mrcal's command, as the arguments of mrcal.optimize.

    The command runs in this process, and its last call of mrcal.optimize is taken. Debian's fails
    with two cameras after that, when it computes a region of valid intrinsics.
    """
    pictures = {
        f"{name}-{picture}": corners
        for name in NAMES
        for picture, corners in read_corners(session / name / "corners.vnl").items()
    }
    document = yaml.safe_load((session / NAMES[0] / "session.yaml").read_text())
    words = command_words(pictures, document, model, focal, folder)
    command = shutil.which(COMMAND)
    assert command
    sys.argv = [command, *words, *(f"{name}-*.png" for name in NAMES)]
    solution: dict[str, Floats] = {}
    optimize = mrcal.optimize

    def recorded(*args: object, **inputs: Floats) -> dict[str, Floats]:
        statistics: dict[str, Floats] = optimize(*args, **inputs)
        solution.clear()
        solution.update(inputs)  # mrcal writes the result into these arrays
        return statistics

    mrcal.optimize = recorded
    try:
        with contextlib.redirect_stdout(sys.stderr), contextlib.suppress(SystemExit, Exception):
            runpy.run_path(command, run_name="__main__")
    finally:
        mrcal.optimize = optimize
    if solution.get("calobject_warp") is None:
        raise RuntimeError(f"{COMMAND} ended before its last fit.")
    return solution


def placed_cameras(inputs: dict[str, Floats]) -> dict[str, PlacedCamera]:
    """Return the cameras of a solution, with its warped board."""
    _, rows, columns, _ = inputs["observations_board"].shape
    board = mrcal.ref_calibration_object(
        columns,
        rows,
        inputs["calibration_object_spacing"],
        calobject_warp=inputs["calobject_warp"],
    ).reshape(-1, 3)
    mountings = np.concatenate([np.zeros((1, 6)), inputs["extrinsics_rt_fromref"]])
    cameras = {}
    for name, lens, mounting in zip(NAMES, inputs["intrinsics"], mountings, strict=True):

        def project(points: Floats, lens: Floats = lens) -> Floats:
            return np.asarray(mrcal.project(points, inputs["lensmodel"], lens))

        cameras[name] = PlacedCamera(project, mounting, board)
    return cameras


if __name__ == "__main__":
    main()
