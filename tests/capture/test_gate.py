"""Each check of the gate: on a rendered view with only that fault, and on detections made
by hand.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.io.images import read_grey
from calib.session.board import Board
from capture.exposure import SquareLighting
from capture.finder import Finder
from capture.frames import Frame
from capture.gate import (
    CHECKS,
    DARK,
    GLARE,
    GOOD_VIEW,
    HIDDEN_BOARD,
    HOLD_STILL,
    KNOWN_VIEW,
    MOTION_BLUR,
    MOVING,
    NO_BOARD,
    OUT_OF_FOCUS,
    WRONG_BOARD,
    judge_frame,
)
from capture.live_detection import LiveDetection
from capture.sharpness import Blur

BOARD = Board(9, 9, 0.02)
FIXTURES = Path(__file__).parents[2] / "fixtures"
VIEWS = (
    "clean/frames/0002.jpg",
    "bumps/frames/0009.jpg",
    "clean/frames/0005.jpg",
    "bumps/holdout/frames/0006.jpg",
)

Grey = NDArray[np.uint8]
each_view = pytest.mark.parametrize("view", VIEWS)


def picture(view: str) -> Grey:
    return np.asarray(read_grey(FIXTURES / view), np.uint8)


def look(pixels: NDArray[np.uint8], time_s: float = 1.0, board: Board = BOARD) -> LiveDetection:
    return Finder(board).look(Frame(pixels, 0, time_s))


def sentence(pixels: Grey, board: Board = BOARD) -> str:
    """Return the decision on a board that stands still, in a new session."""
    return judge_frame(look(pixels, 1.0, board), look(pixels, 0.9, board), ()).sentence


def moved(pixels: Grey, x: float, y: float) -> Grey:
    return np.asarray(
        cv2.warpAffine(
            pixels,
            np.array([[1.0, 0, x], [0, 1.0, y]]),
            pixels.shape[::-1],
            borderMode=cv2.BORDER_REPLICATE,
        )
    )


def streaked(pixels: Grey, length: int, angle: float) -> Grey:
    """Return the mean of the pictures along the motion."""
    steps = np.linspace(-0.5, 0.5, 16) * length
    return np.asarray(
        np.mean([moved(pixels, s * np.cos(angle), s * np.sin(angle)) for s in steps], 0).round(),
        np.uint8,
    )


@each_view
def test_a_good_view_is_kept(view: str) -> None:
    pixels = picture(view)
    verdict = judge_frame(look(pixels), look(pixels, 0.9), ())
    assert verdict.keep
    assert verdict.sentence == GOOD_VIEW
    assert "stay" in GOOD_VIEW


def test_no_board_asks_for_one() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (1232, 1640)).astype(np.uint8)
    for pixels in (
        np.full((1232, 1640), 120, np.uint8),
        np.asarray(cv2.GaussianBlur(noise, (0, 0), 3), np.uint8),
    ):
        assert sentence(pixels) == NO_BOARD
    assert "hold the whole board" in NO_BOARD


@each_view
@pytest.mark.parametrize("squares", [-0.2, 0.5, 1.5], ids=lambda s: f"{s} squares")
def test_a_cut_board_is_to_be_moved_from_that_border(view: str, squares: float) -> None:
    """The border runs through the windows of the outermost corners, or beyond the corners of one
    column, or two.
    """
    pixels = picture(view)
    full = look(pixels)
    assert full.corners is not None
    low, high = (
        full.corners.min(0) + squares * full.square,
        full.corners.max(0) - squares * full.square,
    )
    x_min, y_min = low.astype(int)
    x_max, y_max = high.astype(int)
    cuts = {
        "left": pixels[:, x_min:],
        "top": pixels[y_min:],
        "right": pixels[:, :x_max],
        "bottom": pixels[:y_max],
    }
    for side, cut in cuts.items():
        assert (
            sentence(np.ascontiguousarray(cut))
            == f"The board is cut off at the {side}: move it away from the picture's {side} border."
        )


@each_view
def test_a_covered_board_is_to_be_uncovered(view: str) -> None:
    pixels = picture(view).copy()
    corners = look(pixels).corners
    assert corners is not None
    square = int(look(pixels).square)
    x, y = corners.reshape(9, 9, 2)[4, 4].astype(int)
    cv2.circle(pixels, (int(x), int(y)), 3 * square // 2, 140, -1)
    assert sentence(pixels) == HIDDEN_BOARD
    assert "uncover" in HIDDEN_BOARD


@each_view
def test_another_board_is_not_taken_for_a_part_of_it(view: str) -> None:
    assert sentence(picture(view), Board(9, 6, 0.02)) == WRONG_BOARD
    assert "show that board" in WRONG_BOARD


@each_view
def test_overexposed_white_asks_for_less_light(view: str) -> None:
    assert (
        sentence(np.asarray(np.minimum(picture(view).astype(np.float32) * 1.6, 255), np.uint8))
        == GLARE
    )
    assert "lower exposure" in GLARE


@each_view
def test_white_that_ends_at_the_level_of_television_is_clipped(view: str) -> None:
    assert (
        sentence(np.asarray(np.minimum(picture(view).astype(np.float32) * 1.6, 235), np.uint8))
        == GLARE
    )


@each_view
def test_bright_white_is_not_clipped(view: str) -> None:
    pixels = picture(view).astype(np.float32)
    assert (
        sentence(np.asarray(pixels * (249 / np.percentile(pixels, 99.99)), np.uint8)) == GOOD_VIEW
    )


@each_view
def test_dim_light_asks_for_more(view: str) -> None:
    assert sentence(np.asarray(picture(view) * 0.2, np.uint8)) == DARK
    assert "add light" in DARK


@each_view
def test_motion_between_frames_asks_to_hold_still(view: str) -> None:
    pixels = picture(view)
    assert judge_frame(look(moved(pixels, 2.1, 2.1)), look(pixels, 0.9), ()).sentence == MOVING
    assert judge_frame(look(moved(pixels, 0.3, 0.3)), look(pixels, 0.9), ()).sentence == GOOD_VIEW
    assert "hold it still" in MOVING


@each_view
def test_a_turn_about_the_boards_middle_is_motion(view: str) -> None:
    pixels = picture(view)
    previous = look(pixels, 0.9)
    assert previous.corners is not None
    x, y = previous.corners.mean(0)
    turn = cv2.getRotationMatrix2D(
        (float(x), float(y)), float(np.degrees(3 / np.ptp(previous.corners, axis=0).min() * 2)), 1
    )
    assert (
        judge_frame(
            look(np.asarray(cv2.warpAffine(pixels, turn, pixels.shape[::-1]))), previous, ()
        ).sentence
        == MOVING
    )


@each_view
@pytest.mark.parametrize("angle", [0.0, 0.8, 1.6, 2.4])
def test_a_streak_in_any_direction_is_seen(view: str, angle: float) -> None:
    assert sentence(streaked(picture(view), 3, angle)) == MOTION_BLUR
    assert "hold the board still" in MOTION_BLUR


@each_view
def test_a_soft_picture_asks_for_focus(view: str) -> None:
    assert sentence(np.asarray(cv2.GaussianBlur(picture(view), (0, 0), 2.4))) == OUT_OF_FOCUS
    assert "set the focus" in OUT_OF_FOCUS


@each_view
def test_a_sharp_scene_does_not_excuse_a_soft_board(view: str) -> None:
    """A measure over the full picture would accept this frame."""
    pixels = picture(view)
    corners = look(pixels).corners
    assert corners is not None
    hull = cv2.convexHull(corners.astype(np.float32)).astype(np.int32)
    board = (
        cv2.dilate(cv2.fillConvexPoly(np.zeros_like(pixels), hull, 1), np.ones((61, 61), np.uint8))
        > 0
    )
    scene = np.kron(
        np.random.default_rng(0).integers(40, 200, (77, 103)), np.ones((16, 16))
    ).astype(np.uint8)[:1232, :1640]
    assert sentence(np.where(board, pixels, scene)) == GOOD_VIEW
    assert sentence(np.where(board, cv2.GaussianBlur(pixels, (0, 0), 2.4), scene)) == OUT_OF_FOCUS


@each_view
def test_a_view_that_the_session_has_is_not_new(view: str) -> None:
    pixels = picture(view)
    finder, frame = Finder(BOARD), Frame(pixels, 0, 1.0)
    refined = finder.refine(frame, finder.look(frame))
    assert refined is not None
    square = look(pixels).square
    near, far = moved(pixels, 0.4 * square, 0.3 * square), moved(pixels, 0.9 * square, 0.7 * square)
    assert judge_frame(look(near), look(near, 0.9), [refined]).sentence == KNOWN_VIEW
    assert judge_frame(look(far), look(far, 0.9), [refined]).sentence == GOOD_VIEW
    assert "move the board elsewhere" in KNOWN_VIEW


def seen(
    tilt: float = 0.0, distance: float = 0.6, x: float = 820.0, time_s: float = 1.0
) -> LiveDetection:
    """Return a good detection: 9x9 corners at f = 1280 px, tilted about the picture's vertical."""
    points = BOARD.points()
    depth = distance + points[:, 0] * np.sin(tilt)
    corners = 1280 * np.stack([points[:, 0] * np.cos(tilt), points[:, 1]], -1) / depth[:, None] + (
        x,
        616,
    )
    return LiveDetection(
        corners,
        1640,
        1232,
        time_s,
        square=1280 * 0.02 / distance,
        margin=10,
        blur=Blur(0.7, 0.5),
        exposure=SquareLighting(0.0, 150.0),
    )


BEFORE = seen(time_s=0.9)
SPOILED: tuple[tuple[str, LiveDetection, str], ...] = (
    ("no board", replace(BEFORE, corners=None, time_s=1.0), NO_BOARD),
    (
        "larger",
        replace(BEFORE, corners=None, partial_corners=np.full((100, 2), 600.0), too_large=True),
        WRONG_BOARD,
    ),
    ("part", replace(BEFORE, corners=None, partial_corners=np.full((50, 2), 600.0)), HIDDEN_BOARD),
    ("clipped", replace(seen(), exposure=SquareLighting(0.06, 150.0)), GLARE),
    ("dark", replace(seen(), exposure=SquareLighting(0.0, 39.0)), DARK),
    ("no edges", replace(seen(), blur=None), OUT_OF_FOCUS),
    ("soft", replace(seen(), blur=Blur(2.1, 0.5)), OUT_OF_FOCUS),
    ("streaked", replace(seen(), blur=Blur(0.7, 2.1)), MOTION_BLUR),
    ("moving", seen(x=822.5), MOVING),
    (
        "two things: light comes before motion",
        replace(seen(x=830.0), exposure=SquareLighting(0.0, 39.0)),
        DARK,
    ),
    ("two things: motion comes before blur", replace(seen(x=830.0), blur=Blur(0.7, 9.0)), MOVING),
)


@pytest.mark.parametrize(
    ("detection", "expected"), [case[1:] for case in SPOILED], ids=[case[0] for case in SPOILED]
)
def test_the_gate_names_the_defect_of_each_spoiled_view(
    detection: LiveDetection, expected: str
) -> None:
    verdict = judge_frame(detection, BEFORE, ())
    assert not verdict.keep
    assert verdict.sentence == expected


def test_nothing_spoiled() -> None:
    assert judge_frame(seen(), BEFORE, ()).keep


@pytest.mark.parametrize(
    "previous", [None, replace(BEFORE, corners=None), seen(time_s=1.0), seen(time_s=-5.0)]
)
def test_without_a_frame_just_before_the_board_may_be_moving(
    previous: LiveDetection | None,
) -> None:
    verdict = judge_frame(seen(), previous, ())
    assert not verdict.keep
    assert verdict.sentence == HOLD_STILL


def test_a_photograph_by_itself_is_judged_without_the_one_before() -> None:
    for previous in (None, seen(x=300.0, time_s=0.9)):
        assert judge_frame(seen(), previous, (), isolated=True).keep
        assert (
            judge_frame(replace(seen(), blur=Blur(0.7, 2.1)), previous, (), isolated=True).sentence
            == MOTION_BLUR
        )


@pytest.mark.parametrize(
    "view", [seen(tilt=0.5), seen(distance=0.9), seen(x=900.0)], ids=["tilted", "farther", "aside"]
)
def test_a_view_unlike_the_recorded_one_is_kept(view: LiveDetection) -> None:
    assert view.corners is not None
    assert judge_frame(seen(), BEFORE, [view.corners]).keep


@pytest.mark.parametrize(
    "view",
    [seen(), seen(tilt=0.05), seen(distance=0.62), seen(x=830.0)],
    ids=["same", "tilted", "farther", "aside"],
)
def test_a_view_like_a_recorded_one_is_refused(view: LiveDetection) -> None:
    assert view.corners is not None
    verdict = judge_frame(seen(), BEFORE, [seen(x=1000.0).corners, view.corners])  # type: ignore[list-item]
    assert not verdict.keep
    assert verdict.sentence == KNOWN_VIEW


@pytest.mark.parametrize("side", ["left", "right", "top", "bottom"])
def test_a_corner_whose_window_is_cut(side: str) -> None:
    corners: Callable[[], NDArray[np.float64]] = lambda: seen().corners.copy()  # type: ignore[union-attr]  # noqa: E731
    low, high = corners().min(0), corners().max(0)
    shift = {
        "left": (9 - low[0], 0),
        "right": (1630 - high[0], 0),
        "top": (0, 9 - low[1]),
        "bottom": (0, 1222 - high[1]),
    }[side]
    detection = replace(seen(time_s=1.0), corners=corners() + shift)
    previous = replace(seen(time_s=0.9), corners=corners() + shift)
    assert (
        judge_frame(detection, previous, ()).sentence
        == f"The board is cut off at the {side}: move it away from the picture's {side} border."
    )
    inner = {"left": (2, 0), "right": (-2, 0), "top": (0, 2), "bottom": (0, -2)}[side]
    detection = replace(detection, corners=corners() + shift + inner)
    previous = replace(previous, corners=corners() + shift + inner)
    assert judge_frame(detection, previous, ()).keep


def test_the_registry_holds_the_documented_checks() -> None:
    assert [check.__name__ for check in CHECKS] == [
        "check_detection",
        "check_borders",
        "check_exposure",
        "check_novelty",
        "check_motion",
        "check_sharpness",
    ]
