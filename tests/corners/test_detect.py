"""One picture -> corners, on drawn boards whose corners are known; and the drawing, which the
neighbouring tests use as well.
"""

from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners import detect
from calib.corners.detect import (
    eight_bits,
    find_corners,
    half_window,
    is_regular,
    largest_grid,
    refine,
)
from calib.session.board import Board

BOARD = Board(9, 6, 0.025)
FINE = 4  # samples per pixel and axis


@dataclass(frozen=True)
class Scene:
    """A board before a pinhole camera, in squares and radians."""

    board: Board = BOARD
    size: tuple[int, int] = (640, 480)
    distance: float = 16.0
    tilt: tuple[float, float] = (0.4, 0.3)
    roll: float = 0.2
    focal: float = 500.0
    margin: float = 1.0
    ground: int = 90
    noise: float = 2.0
    seed: int = 0

    def draw(self) -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
        """The (H, W) picture, and the (count, 2) px corners, the first one's outward square
        black.
        """
        columns, rows, texel = self.board.columns, self.board.rows, 24
        border = round(self.margin * texel)
        squares = np.add.outer(np.arange(rows + 1), np.arange(columns + 1)) % 2
        print_ = np.kron(np.where(squares == 0, 20, 235), np.ones((texel, texel))).astype(np.uint8)
        print_ = np.pad(print_, border, constant_values=235)
        rotation = cv2.Rodrigues(np.array([0, 0, self.roll]))[0]
        rotation = (
            rotation
            @ cv2.Rodrigues(np.array([self.tilt[0], 0, 0]))[0]
            @ cv2.Rodrigues(np.array([0, self.tilt[1], 0]))[0]
        )
        width, height = self.size
        camera = np.array(
            [[self.focal, 0, (width - 1) / 2], [0, self.focal, (height - 1) / 2], [0, 0, 1]]
        )
        px_from_squares = camera @ np.column_stack([rotation[:, :2], (0, 0, self.distance)])
        middle = (0.5 - border) / texel - np.array([columns + 1, rows + 1]) / 2
        squares_from_texels = np.array(
            [[1 / texel, 0, middle[0]], [0, 1 / texel, middle[1]], [0, 0, 1]]
        )
        fine_from_px = np.array([[FINE, 0, (FINE - 1) / 2], [0, FINE, (FINE - 1) / 2], [0, 0, 1]])
        mapping = fine_from_px @ px_from_squares @ squares_from_texels
        fine = cv2.warpPerspective(
            print_, mapping, (FINE * width, FINE * height), borderValue=self.ground
        )
        light = cv2.resize(fine, self.size, interpolation=cv2.INTER_AREA).astype(np.float32)
        light = cv2.GaussianBlur(light, (0, 0), 0.7) + np.random.default_rng(self.seed).normal(
            0, self.noise, light.shape
        )
        points = (
            np.column_stack([self.board.points() / self.board.square, np.ones(self.board.count)])
            @ px_from_squares.T
        )
        return np.clip(np.rint(light), 0, 255).astype(np.uint8), points[:, :2] / points[:, 2:]


def moved_along_x(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the picture of a board that moves by five pixels along x in the exposure."""
    return np.asarray(cv2.blur(picture, (5, 1)), np.uint8)


def rms(corners: NDArray, truth: NDArray) -> float:
    """px, of the distances."""
    return float(np.sqrt(((corners - truth) ** 2).sum(1).mean()))


SCENES = {
    "plain": Scene(),
    "far": Scene(distance=30.0),
    "near and tilted": Scene(distance=14.0, tilt=(0.9, 0.2), focal=400.0),
    "large": Scene(size=(1640, 1232), focal=1279.0, distance=24.0),
    "fills eight megapixels": Scene(
        size=(3280, 2464), focal=2558.0, distance=10.0, tilt=(0.2, -0.3)
    ),
    "on a dark ground": Scene(ground=10),
    "dim and noisy": Scene(noise=6.0),
}


@pytest.fixture
def no_saddles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Find no saddles, as if the squares were too few pixels wide."""
    monkeypatch.setattr(detect, "SEARCHES", detect.SEARCHES[1:])


@pytest.mark.parametrize("scene", SCENES.values(), ids=SCENES.keys())
def test_corners_are_where_they_were_drawn(scene: Scene) -> None:
    picture, truth = scene.draw()
    detection = find_corners(picture, scene.board)
    assert detection is not None
    assert detection.detector == "saddles"
    assert detection.corners.shape == (54, 2)
    assert detection.corners.dtype == np.float64
    assert rms(detection.corners, truth) < 0.08


@pytest.mark.parametrize("quarters", range(4))
def test_blurs_belong_to_the_edges_of_the_board(quarters: int) -> None:
    """Motion along the rows crosses the edges along the columns, however the picture is turned."""
    picture, _ = Scene(tilt=(0.2, 0.1), roll=0.0).draw()
    detection = find_corners(np.rot90(moved_along_x(picture), quarters), BOARD)
    assert detection is not None
    assert (detection.blurs[:, 1] > 1.4 * detection.blurs[:, 0]).all()


def test_sixteen_bits_give_the_same_corners() -> None:
    picture, truth = Scene().draw()
    deep = picture.astype(np.uint16) * 16 + 300  # twelve bits, in the lower part of sixteen
    deep[0, :3] = 65535  # hot pixels
    detection = find_corners(deep, BOARD)
    assert detection is not None
    assert rms(detection.corners, truth) < 0.08


def test_sixteen_bits_of_one_grey_are_eight_bits_of_one_grey() -> None:
    assert not eight_bits(np.full((20, 30), 5000, np.uint16)).any()


def test_the_sector_detector_takes_over_if_the_saddles_form_no_grid(no_saddles: None) -> None:
    del no_saddles
    picture, truth = Scene().draw()
    detection = find_corners(picture, BOARD)
    assert detection is not None
    assert detection.detector == "sb"
    assert rms(detection.corners, truth) < 0.08


def test_the_classic_detector_takes_over_if_the_sector_detector_fails(
    monkeypatch: pytest.MonkeyPatch, no_saddles: None
) -> None:
    del no_saddles
    picture, truth = Scene().draw()
    monkeypatch.setattr(cv2, "findChessboardCornersSB", lambda *_, **__: (False, None))
    monkeypatch.setattr(
        cv2, "findChessboardCornersSBWithMeta", lambda *_, **__: (False, None, None)
    )
    detection = find_corners(picture, BOARD)
    assert detection is not None
    assert detection.detector == "classic"
    assert rms(detection.corners, truth) < 0.08


@pytest.mark.parametrize("ground", [90, 230], ids=["grey", "bright"])
def test_a_board_without_a_white_margin_is_found(ground: int) -> None:
    picture, truth = Scene(margin=0.0, ground=ground).draw()
    detection = find_corners(picture, BOARD)
    assert detection is not None
    assert rms(detection.corners, truth) < 0.08


def test_wrong_corners_of_the_sector_detector_are_replaced(
    monkeypatch: pytest.MonkeyPatch, no_saddles: None
) -> None:
    del no_saddles
    picture, truth = Scene().draw()

    def astray(search: Callable[..., tuple]) -> Callable[..., tuple]:
        def searched(*args: object, **kwargs: object) -> tuple:
            detection, corners, *extra = search(*args, **kwargs)
            corners.reshape(-1, 2)[20] += 25.0
            return detection, corners, *extra

        return searched

    for name in ("findChessboardCornersSB", "findChessboardCornersSBWithMeta"):
        monkeypatch.setattr(cv2, name, astray(getattr(cv2, name)))
    detection = find_corners(picture, BOARD)
    assert detection is not None
    assert detection.detector == "classic"
    assert rms(detection.corners, truth) < 0.08


def test_wrong_corners_of_the_saddles_are_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    picture, truth = Scene().draw()
    search = detect._by_saddles

    def astray(grey: NDArray[np.uint8], board: Board) -> detect.LocatedBoard:
        rough = search(grey, board)
        assert rough
        rough.corners[20] += 25.0
        return rough

    monkeypatch.setattr(detect, "SEARCHES", (("saddles", astray), *detect.SEARCHES[1:]))
    detection = find_corners(picture, BOARD)
    assert detection is not None
    assert detection.detector == "sb"
    assert rms(detection.corners, truth) < 0.08


def test_corners_that_are_found_some_pixels_off_are_mended(
    monkeypatch: pytest.MonkeyPatch, no_saddles: None
) -> None:
    """SB does so where the board is strongly tilted."""
    del no_saddles
    picture, truth = Scene().draw()
    search = cv2.findChessboardCornersSBWithMeta

    def vague(*args: object) -> tuple:
        detection, corners, meta = search(*args)  # type: ignore[call-overload]
        return (
            detection,
            corners + np.random.default_rng(0).uniform(-4, 4, corners.shape).astype(np.float32),
            meta,
        )

    monkeypatch.setattr(cv2, "findChessboardCornersSBWithMeta", vague)
    detection = find_corners(picture, BOARD)
    assert detection is not None
    assert rms(detection.corners, truth) < 0.08


@pytest.mark.parametrize("shape", [(480, 640), (8, 8), (1, 1), (900, 10)], ids=str)
def test_no_board_is_found_in_pictures_without_one(shape: tuple[int, int]) -> None:
    noise = np.random.default_rng(0).integers(0, 255, shape, np.uint8)
    assert find_corners(noise, BOARD) is None
    assert find_corners(np.zeros(shape, np.uint8), BOARD) is None


def test_a_covered_corner_makes_the_view_unusable() -> None:
    picture, truth = Scene().draw()
    cv2.circle(picture, (int(truth[30, 0]), int(truth[30, 1])), 35, 120, -1)
    assert find_corners(picture, BOARD) is None


def test_the_grid_check_passes_strong_perspective_and_a_barrel() -> None:
    scene = Scene(distance=9.0, tilt=(1.0, 0.5), focal=300.0)
    truth = scene.draw()[1]
    assert is_regular(truth, BOARD, (480, 640))
    error = (truth - (320, 240)) / 300
    barrel = error * (
        1 - 0.3 * (error**2).sum(1, keepdims=True) + 0.08 * (error**2).sum(1, keepdims=True) ** 2
    ) * 300 + (320, 240)
    assert is_regular(barrel, BOARD, (480, 640))


def flat() -> NDArray[np.float64]:
    """(6, 9, 2) px, squares of 30."""
    middle = np.array([320, 240])
    return np.asarray(Board(9, 6, 30.0).points().reshape(6, 9, 2) + middle)


@pytest.mark.parametrize("where", [(0, 0), (0, 4), (5, 8), (2, 3), (4, 7)], ids=str)
@pytest.mark.parametrize("shift", [(15, 0), (0, -15), (9, 9)], ids=str)
def test_the_grid_check_catches_one_corner_moved_by_half_a_square(
    where: tuple[int, int], shift: tuple[int, int]
) -> None:
    grid = flat()
    assert is_regular(grid.reshape(-1, 2), BOARD, (480, 640))
    grid[where] += shift
    assert not is_regular(grid.reshape(-1, 2), BOARD, (480, 640))


@pytest.mark.parametrize("row", [1, 3, 5])
def test_the_grid_check_catches_a_skipped_row(row: int) -> None:
    grid = flat()
    grid[row:, :, 1] += 30
    assert not is_regular(grid.reshape(-1, 2), BOARD, (480, 640))


def test_the_grid_check_catches_a_skipped_row_of_the_smallest_board() -> None:
    board = Board(3, 3, 30.0)
    grid = board.points().reshape(3, 3, 2) + 200
    assert is_regular(grid.reshape(-1, 2), board, (480, 640))
    grid[2:, :, 1] += 30
    assert not is_regular(grid.reshape(-1, 2), board, (480, 640))


def test_the_grid_check_catches_folds_and_corners_outside_and_undefined_ones() -> None:
    folded, shifted, undefined = flat(), flat(), flat()
    folded[5] = folded[3]
    shifted += (300, 0)
    undefined[2, 2] = np.nan
    for grid in (folded, shifted, undefined):
        assert not is_regular(grid.reshape(-1, 2), BOARD, (480, 640))


@pytest.mark.parametrize(("square", "half"), [(4.0, 2), (8.0, 3), (20.0, 8), (100.0, 15)])
def test_the_refining_window_ends_before_the_neighbouring_corner(square: float, half: int) -> None:
    corners = Board(9, 6, square).points()
    assert half_window(corners, BOARD) == half
    assert half * np.sqrt(2) < square
    sheared = corners @ np.array(
        [[1.0, 0.0], [0.8, 0.6]]
    )  # rows of the same spacing, but one diagonal shorter
    assert half_window(sheared, BOARD) <= half


def test_tiny_squares_keep_their_own_corners() -> None:
    picture, truth = Scene(distance=70.0, tilt=(0.1, 0.1), noise=0.5).draw()  # squares of 7 px
    start = truth + np.random.default_rng(1).uniform(-0.8, 0.8, truth.shape)
    assert rms(refine(picture, start, BOARD), truth) < 0.15


@pytest.mark.parametrize("board", [Board(9, 6, 1.0), Board(7, 7, 1.0), Board(6, 8, 1.0)], ids=str)
def test_the_size_of_an_undeclared_board_is_measured(board: Board) -> None:
    picture, truth = Scene(board=board).draw()
    grid = largest_grid(picture)
    assert grid is not None
    assert grid.size == (max(board.columns, board.rows), min(board.columns, board.rows))
    assert np.linalg.norm(grid.corners[:, None] - truth, axis=-1).min(0).max() < 2
