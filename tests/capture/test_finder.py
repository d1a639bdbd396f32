"""The live finder on rendered views: it agrees with the detector of the calibration, and survives
pictures of any kind.
"""

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners.detect import find_corners, refine
from calib.io.images import list_images, read_grey
from calib.session.board import Board
from capture.finder import Finder
from capture.frames import Frame
from capture.live_detection import LiveDetection
from tests.corners.test_detect import Scene, rms

BOARD = Board(9, 9, 0.02)
FIXTURES = Path(__file__).parents[2] / "fixtures"


def frame(pixels: NDArray[np.uint8]) -> Frame:
    return Frame(pixels, 7, 2.5)


def look(pixels: NDArray[np.uint8], board: Board = BOARD) -> LiveDetection:
    return Finder(board).look(frame(pixels))


@pytest.mark.parametrize(
    "folder", ["clean/holdout/frames", "bumps/frames", "covered-bare/frames", "covered-bare/bare"]
)
def test_corners_are_those_of_the_full_detector(folder: str) -> None:
    finder = Finder(BOARD)
    pictures = list_images(FIXTURES / folder)[::4]
    assert len(pictures) >= 3
    for path in pictures:
        detected = frame(np.asarray(read_grey(path), np.uint8))
        full = find_corners(detected.pixels, BOARD)
        detection = finder.look(detected)
        refined = finder.refine(detected, detection)
        assert full is not None
        assert detection.corners is not None, path
        assert refined is not None, path
        assert rms(detection.corners, full.corners) < 0.2, path
        assert rms(refined, refine(detected.pixels, full.corners, BOARD)) < 0.02, (
            path
        )  # what a calibration's own measurement starts from
        assert (detection.width, detection.height, detection.time_s) == (*detected.size, 2.5)


def test_every_rendered_board_is_found() -> None:
    pictures = [
        path
        for folder in ("clean", "clean/holdout", "bumps/holdout")
        for path in list_images(FIXTURES / folder / "frames")
    ]
    assert len(pictures) == 24 + 10 + 10
    for path in pictures:
        assert look(np.asarray(read_grey(path), np.uint8)).corners is not None, path


@pytest.mark.parametrize(
    "scene",
    [
        Scene(),
        Scene(distance=30.0),
        Scene(distance=14.0, tilt=(0.9, 0.2), focal=400.0),
        Scene(size=(3280, 2464), focal=2558.0, distance=10.0, tilt=(0.2, -0.3)),
        Scene(size=(641, 483), ground=10),
        Scene(board=Board(6, 9, 0.02), roll=1.2),
        Scene(board=Board(3, 3, 0.02), distance=9.0),
    ],
)
def test_drawn_boards(scene: Scene) -> None:
    picture, truth = scene.draw()
    finder = Finder(scene.board)
    detection = finder.look(frame(picture))
    refined = finder.refine(frame(picture), detection)
    assert refined is not None
    assert min(rms(refined, truth), rms(refined, truth[::-1])) < 0.1


def test_colour_is_seen_as_grey() -> None:
    grey, _ = Scene().draw()
    board = Scene().board
    item, second = look(grey, board).corners, look(np.repeat(grey[..., None], 3, 2), board).corners
    assert item is not None
    assert second is not None
    assert rms(item, second) == 0


@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (3, 2000), (480, 640), (481, 643, 3)])
@pytest.mark.parametrize("level", [0, 128, 255])
def test_pictures_of_nothing(shape: tuple[int, ...], level: int) -> None:
    detection = look(np.full(shape, level, np.uint8))
    assert detection.corners is None
    assert detection.partial_corners is None
    assert Finder(BOARD).refine(frame(np.full(shape, level, np.uint8)), detection) is None


def test_blur_is_measured_in_px() -> None:
    """Oracle: normal blurs add their variances; the renderer's own is 0.6 px and the pixel's
    square.
    """
    pixels = np.asarray(read_grey(FIXTURES / "clean/frames/0002.jpg"), np.uint8)
    for added in (0.0, 0.8, 1.6):
        blurred = (
            pixels if added == 0 else np.asarray(cv2.GaussianBlur(pixels, (0, 0), added), np.uint8)
        )
        blur = look(blurred).blur
        assert blur is not None
        assert blur.sigma == pytest.approx((0.6**2 + 1 / 12 + added**2) ** 0.5, abs=0.06)
        assert blur.streak < 1.0


@pytest.mark.parametrize("angle", np.linspace(0, np.pi, 7)[:-1])
def test_a_streak_is_measured_in_any_direction(angle: float) -> None:
    pixels = np.asarray(read_grey(FIXTURES / "clean/frames/0002.jpg"), np.uint8)
    shifts = [
        5 * step * np.array([np.cos(angle), np.sin(angle)]) for step in np.linspace(-0.5, 0.5, 26)
    ]
    size = pixels.shape[::-1]
    passing = [
        cv2.warpAffine(
            pixels, np.array([[1, 0, x], [0, 1, y]]), size, borderMode=cv2.BORDER_REPLICATE
        )
        for x, y in shifts
    ]
    blur = look(np.asarray(np.mean(passing, 0).round(), np.uint8)).blur
    assert blur is not None
    assert blur.streak == pytest.approx(5.0, abs=0.75)  # its spread is no normal blur's


def test_exposure_is_measured_on_the_squares() -> None:
    pixels = np.asarray(read_grey(FIXTURES / "clean/frames/0002.jpg"), np.uint8)
    plain, bright = (
        look(pixels).exposure,
        look(np.asarray(np.minimum(pixels * 1.6, 255), np.uint8)).exposure,
    )
    assert plain is not None
    assert bright is not None
    assert plain.clipped == 0
    assert plain.contrast == pytest.approx(165, abs=10)
    assert bright.clipped > 0.9
