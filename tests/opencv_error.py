"""The error that OpenCV leaves on the views of a calibration, and nearer than them, for a
comparison without a cover. `python -m tests.opencv_error` prints it for `calib demo`.
"""

import json
import shutil
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.cli import main as calib
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from fixtures.rays import FIXTURES

FLAGS = {
    5: 0,
    14: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL | cv2.CALIB_TILTED_MODEL,
}
"""The flags of cv2.calibrateCamera for a lens with that many coefficients."""
NEAR = (0.15, 0.25)
"""m, of boards nearer than those of the demo."""
BOARDS, FEWEST = 20, 20
"""The number of near boards, and the fewest corners of one in the picture."""
MARGIN = 10.0
"""px: the distance of a corner from the border of the picture."""

Array = NDArray[np.float64]


def main() -> None:
    with TemporaryDirectory() as folder:
        demo = Path(folder) / "demo"
        with redirect_stdout(StringIO()) as output:
            calib(["demo", "-o", str(demo), "--json"])
        calibration = Calibration.load(demo / "calibration")
        unmeasured = fit_without_numbers(demo, Path(folder))
    fit_error = json.loads(output.getvalue())["stages"][-1]["rms_px"]
    names = [
        *(f"OpenCV, {count} coefficients" for count in FLAGS),
        "Refracal, told that there is a window in water",
        "Refracal, told the lens and the window",
    ]
    ours = unmeasured.stages[-1].rms_px, fit_error
    fitted = [*(opencv_error(calibration, count) for count in FLAGS), *ours]
    nearby = [opencv_error_nearby(calibration, count) for count in FLAGS]
    nearby += [demo_error_nearby(unmeasured), demo_error_nearby(calibration)]
    print("Error of each program, root mean square")
    for place, errors in (
        ("on the fitted pictures", fitted),
        (f"at {NEAR[0]:g} to {NEAR[1]:g} m", nearby),
    ):
        rows = zip(names, errors, strict=True)
        print(f"{place}: " + "; ".join(f"{name} {error:.3f} px" for name, error in rows))
    print(f"noise of the corners: {calibration.noise_px:.3f} px")


def fit_without_numbers(demo: Path, folder: Path) -> Calibration:
    """Return the fit of the demo's pictures that is told the board, the shape of the cover and the
    index of the water alone. It is written into the folder.
    """
    pictures = shutil.copytree(demo / "frames", folder / "pictures")
    board = ["--board", "9x9", "--square-mm", "20"]
    with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
        calib(["fit", str(pictures), *board, "--cover", "flat", "--outside-index", "1.34", "-q"])
    return Calibration.load(pictures / "calibration")


def opencv_error(calibration: Calibration, coefficients: int) -> float:
    """Return the root mean square error in px of cv2.calibrateCamera on the same corners."""
    return _calibrate(calibration, coefficients)[0]


def opencv_error_nearby(calibration: Calibration, coefficients: int) -> float:
    """Return the root mean square error in px of the same lens on boards at NEAR, each with the
    pose that fits best. The corners are those that the calibration's rays give.
    """
    _, matrix, distortion = _calibrate(calibration, coefficients)
    path, values = calibration.model()
    board = _points(calibration)
    rng = np.random.default_rng(0)
    size = np.array([calibration.camera.width, calibration.camera.height])
    squares: list[float] = []
    while len(squares) < BOARDS:
        turn = rng.uniform([-0.6, -0.6, -0.3], [0.6, 0.6, 0.3])
        depth = rng.uniform(*NEAR)
        move = np.array([*rng.uniform(-1, 1, 2) * [0.62, 0.46] * depth, depth])
        points = board @ cv2.Rodrigues(turn)[0].T + move
        pixels = project(path, values, torch.from_numpy(points), MIDDLE).numpy()
        in_picture = ((pixels > MARGIN) & (pixels < size - MARGIN)).all(-1)  # false for NaN
        if in_picture.sum() < FEWEST:
            continue
        problem = board[in_picture], pixels[in_picture], matrix, distortion
        _, near_turn, near_move = cv2.solvePnP(*problem, turn, move, useExtrinsicGuess=True)
        best = cv2.solvePnPRefineLM(*problem, near_turn, near_move)
        modelled = cv2.projectPoints(problem[0], best[0], best[1], matrix, distortion)[0]
        squares.append(float(((modelled.reshape(-1, 2) - problem[1]) ** 2).sum(-1).mean()))
    return float(np.sqrt(np.mean(squares)))


def demo_error_nearby(calibration: Calibration) -> float:
    """Return the root mean square distance in px between the pixels of the demo's calibration and
    those of the renderer, for points at both ends of NEAR on the renderer's rays.
    """
    path, values = calibration.model()
    truth = np.load(FIXTURES / "wet-flat" / "water" / "truth.npz")
    origins, directions = truth["origins"], truth["directions"]
    squares = []
    for depth in NEAR:
        points = origins + directions * ((depth - origins[:, 2:]) / directions[:, 2:])
        error = project(path, values, torch.from_numpy(points), MIDDLE).numpy() - truth["pixels"]
        squares.append(np.nanmean((error**2).sum(-1)))
    return float(np.sqrt(np.mean(squares)))


def _calibrate(calibration: Calibration, coefficients: int) -> tuple[float, Array, Array]:
    views = [np.asarray(view.seen, bool) for view in calibration.views]
    board = _points(calibration)
    corners = [
        np.asarray(view.corners, np.float32)[detected]
        for view, detected in zip(calibration.views, views, strict=True)
    ]
    points = [np.asarray(board[detected], np.float32) for detected in views]
    size = calibration.camera.width, calibration.camera.height
    start = np.eye(3), np.zeros(coefficients)
    error, matrix, distortion, *_ = cv2.calibrateCamera(
        points, corners, size, *start, flags=FLAGS[coefficients]
    )
    return float(error), np.asarray(matrix, np.float64), np.asarray(distortion, np.float64)


def _points(calibration: Calibration) -> Array:
    return np.column_stack([calibration.board.points(), np.zeros(calibration.board.count)])


if __name__ == "__main__":
    main()
