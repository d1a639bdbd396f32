"""The error that OpenCV leaves on the views of a calibration, and nearer than them, for a
comparison without a cover. `python -m tests.opencv_error` prints it for `calib demo`.
"""

import json
import shutil
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares

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
BOARDS, POINTS = 20, 100
"""The number of near boards, and of the points on one of them."""
HALF = 0.08
"""m, half of the side of a board."""
MARGIN = 10.0
"""px: the distance of a point from the border of the picture."""

Array = NDArray[np.float64]
Projection = Callable[[Array], Array]
"""The (N, 2) px of (N, 3) m in the camera's frame."""


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
    projections = [opencv_projection(calibration, count) for count in FLAGS]
    projections += [refracal_projection(unmeasured), refracal_projection(calibration)]
    nearby = [error_nearby(projection) for projection in projections]
    print("Error of each program, root mean square, each board with the pose that fits best")
    for place, errors, digits in (
        ("on the fitted pictures", fitted, 3),
        (f"at {NEAR[0]:g} to {NEAR[1]:g} m", nearby, 4),
    ):
        rows = zip(names, errors, strict=True)
        print(f"{place}: " + "; ".join(f"{name} {error:.{digits}f} px" for name, error in rows))
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


def opencv_projection(calibration: Calibration, coefficients: int) -> Projection:
    """Return the projection of the lens of cv2.calibrateCamera on the same corners."""
    _, matrix, distortion = _calibrate(calibration, coefficients)

    def projection(points: Array) -> Array:
        pixels, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, distortion)
        return np.asarray(pixels, np.float64).reshape(-1, 2)

    return projection


def refracal_projection(calibration: Calibration) -> Projection:
    """Return the projection of a calibration."""
    path, values = calibration.model()
    return lambda points: project(path, values, torch.from_numpy(points), MIDDLE).numpy()


def error_nearby(projection: Projection) -> float:
    """Return the root mean square error in px on boards at NEAR, each with the pose that fits best.
    The points of a board lie on the rays of the renderer, without noise.
    """
    squares = []
    for points, pixels, pose in near_boards():

        def residual(
            pose: Array, points: Array = points, pixels: Array = pixels
        ) -> NDArray[np.float64]:
            moved = points @ cv2.Rodrigues(pose[:3])[0].T + pose[3:]
            return np.asarray((projection(moved) - pixels).ravel())

        best = least_squares(residual, pose, x_scale=[1.0] * 3 + [0.1] * 3)
        squares.append(2 * np.mean(best.fun**2))
    return float(np.sqrt(np.mean(squares)))


def near_boards() -> Iterator[tuple[Array, Array, Array]]:
    """Yield for each board at NEAR (N, 3) points on it, m, their (N, 2) px in the renderer's
    picture, and the (6,) pose, rad and m.
    """
    truth = np.load(FIXTURES / "wet-flat" / "water" / "truth.npz")
    origins = truth["origins"].reshape(-1, 3)
    directions = truth["directions"].reshape(-1, 3)
    pixels = truth["pixels"].reshape(-1, 2)
    last = pixels.max(0) - MARGIN
    usable = ((pixels >= MARGIN) & (pixels <= last)).all(-1) & np.isfinite(origins).all(-1)
    rng = np.random.default_rng(0)
    count = 0
    while count < BOARDS:
        turn = rng.uniform([-0.6, -0.6, -0.3], [0.6, 0.6, 0.3])
        depth = rng.uniform(*NEAR)
        move = np.array([*rng.uniform(-1, 1, 2) * [0.62, 0.46] * depth, depth])
        rotation = cv2.Rodrigues(turn)[0]
        along = ((move - origins) @ rotation[:, 2]) / (directions @ rotation[:, 2])
        points = (origins + along[:, None] * directions - move) @ rotation
        on_board = usable & (along > 0) & (np.abs(points[:, :2]) <= HALF).all(-1)
        if on_board.sum() < POINTS:
            continue
        chosen = rng.choice(np.flatnonzero(on_board), POINTS, replace=False)
        yield points[chosen] * [1, 1, 0], pixels[chosen], np.concatenate([turn, move])
        count += 1


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
