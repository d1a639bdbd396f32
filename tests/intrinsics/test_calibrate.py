"""Zhang's method on views of a known camera: what it says of its own errors."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.intrinsics.calibrate import calibrate_bare
from calib.intrinsics.opencv_lens import CRITERIA
from calib.progress import Silent
from calib.session.board import Board
from calib.session.camera import Intrinsics
from fixtures.calibrated import CAMERA, calibrated
from fixtures.map_errors import errors
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, bare_views, scene

BOARD = Board(9, 9, 0.020)
LENS = (-0.05, 0.01, 1e-3, -5e-4, 0.004)
TRUE = np.array(
    [INTRINSICS.fx.value, INTRINSICS.fy.value, INTRINSICS.cx.value, INTRINSICS.cy.value, *LENS]
)
DRAWS = 40
SESSIONS = 5


def found(seed: int) -> Intrinsics:
    views = bare_views(seed, 10, 0.2, LENS)
    return calibrate_bare(
        views, BOARD, replace(CAMERA, intrinsics=None, lens_coefficients=5), Silent()
    ).intrinsics


def parts(
    intrinsics: Intrinsics,
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """(9,) values, (9,) sigmas, (9, 9) correlations."""
    numbers = (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy, *intrinsics.distortion)
    correlation = np.eye(len(numbers))
    for i, row in enumerate(intrinsics.correlations, 1):
        correlation[i, :i] = correlation[:i, i] = row
    return np.array([n.value for n in numbers]), np.array([n.sigma for n in numbers]), correlation


def test_standard_deviations_agree_with_those_of_opencv() -> None:
    views = bare_views(1, 10, 0.2, LENS)
    points = np.column_stack([BOARD.points(), np.zeros(BOARD.count)]).astype(np.float32)
    start = np.array([[WIDTH, 0, WIDTH / 2], [0, WIDTH, HEIGHT / 2], [0, 0, 1.0]])
    pixels = [view.corners.astype(np.float32) for view in views]
    theirs = cv2.calibrateCameraExtended(
        [points] * 10, pixels, (WIDTH, HEIGHT), start, np.zeros(5), criteria=CRITERIA
    )[5]
    _, ours, _ = parts(found(1))
    # ours weighs corners by a noise that it estimates, OpenCV by the residual: 0.4 % apart
    assert ours == pytest.approx(np.ravel(theirs)[:9], rel=1e-2)


@pytest.mark.slow
def test_errors_scatter_as_the_covariance_says() -> None:
    """Other poses and other noise each time. In each of the nine directions in which errors are
    independent, the tightest as well as the loosest, the mean square is 1, within what chance
    leaves in one of ten thousand; by the sigmas alone the tightest has 0.01.
    """
    whitened, loose = [], []
    for seed in range(DRAWS):
        values, sigmas, correlation = parts(found(seed))
        power, directions = np.linalg.eigh(correlation)
        error = directions.T @ ((values - TRUE) / sigmas)
        whitened.append(error / np.sqrt(power))
        loose.append(error)
    squares, alone = np.mean(np.square(whitened), 0), np.mean(np.square(loose), 0)
    print(f"by covariance {squares.round(2)}, by sigmas alone {alone.round(3)}")
    low = chi2.ppf(5e-05, DRAWS) / DRAWS
    high = chi2.ppf(1 - 5e-05, DRAWS) / DRAWS
    assert ((low < squares) & (squares < high)).all()
    assert squares.mean() == pytest.approx(1, abs=3 * (2 / DRAWS / 9) ** 0.5)
    assert alone[0] < 0.05


@pytest.mark.slow
def test_a_covered_fit_gains_from_the_correlations() -> None:
    """Few covered views and a noisy bare/: the ratio of the focal lengths, which the sigmas alone
    leave to the glass, stays nearer to what bare/ knows (0.63 px against 0.87 px), and the maps are
    as good or better. Of five sessions, chance may take a third of the one, and a tenth of the
    other.
    """
    settings = Settings(grid=(6, 6), free=("none",))
    deviations: dict[bool, list[float]] = {True: [], False: []}
    maps: dict[bool, list[float]] = {True: [], False: []}
    for seed in range(SESSIONS):
        made = scene(seed, views=6, amplitude=3e-6, noise=0.1)
        camera = replace(CAMERA, intrinsics=None, lens_coefficients=5)
        bare = calibrate_bare(
            bare_views(1000 + seed, 8, 0.3), made.board, camera, Silent()
        ).intrinsics
        for full in (True, False):
            arguments = bare if full else replace(bare, correlations=())
            result = calibrated(made, Setup(made.board, CAMERA, arguments, made.cover), settings)
            k = result.camera.intrinsics
            assert k
            deviations[full].append((k.fx.value - k.fy.value) ** 2)
            maps[full].append(float(np.mean(list(errors(made, result))[-1][0] ** 2)))
    ours = float(np.sqrt(np.mean(deviations[True])))
    theirs = float(np.sqrt(np.mean(deviations[False])))
    our_maps = float(np.sqrt(np.mean(maps[True])))
    their_maps = float(np.sqrt(np.mean(maps[False])))
    print(
        f"fx - fy {ours:.2f}, by sigmas alone {theirs:.2f} px; maps {our_maps:.3f},"
        f" {their_maps:.3f} px"
    )
    assert ours < 0.8 * theirs
    assert our_maps < 1.1 * their_maps
