"""Boards with markers in the live picture: detected as far as it shows them, judged, recorded, and
refused in a sentence where they are not the declared ones.
"""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners.detection import Detection
from calib.corners.find import find_board
from calib.session.board import Board
from calib.session.session import read_session
from capture.coded_finder import CodedFinder
from capture.finders import make_finder
from capture.frames import Frame
from capture.gate import (
    DARK,
    GLARE,
    GOOD_VIEW,
    HOLD_STILL,
    KNOWN_VIEW,
    MOTION_BLUR,
    MOVING,
    OUT_OF_FOCUS,
    judge_frame,
)
from capture.live_detection import LiveDetection
from fixtures.coded_boards import CHARUCO, GRID, KINDS, LEGACY, LENS, PARTIAL, WHOLE
from fixtures.coded_pictures import Lens
from tests.capture.recordings import capture

Grey = NDArray[np.uint8]

each_kind = pytest.mark.parametrize("name", KINDS)
each_pose = pytest.mark.parametrize("pose", ["whole", "partial"])
POSES = {"whole": WHOLE, "partial": PARTIAL}


def drawn(name: str, pose: str = "whole") -> tuple[Grey, NDArray[np.float64]]:
    """Return the picture and its corners, px."""
    view = KINDS[name].view(POSES[pose])
    return view.picture, view.corners


def look(pixels: Grey, board: Board, time_s: float = 1.0) -> LiveDetection:
    return make_finder(board).look(Frame(pixels, 0, time_s))


def sentence(pixels: Grey, board: Board) -> str:
    """Return the decision on a board that stands still, in a new session."""
    finder = make_finder(board)
    previous = finder.look(Frame(pixels, 0, 0.9))
    current = finder.look(Frame(pixels, 0, 1.0))
    return judge_frame(current, previous, ()).sentence


def off(corners: NDArray[np.float64] | None, truth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (n,) px, the errors of the detected corners."""
    assert corners is not None
    distances = np.linalg.norm(corners - truth, axis=1)
    return np.asarray(distances[np.isfinite(distances)])


def enlarged(
    picture: Grey, corners: NDArray[np.float64], factor: int
) -> tuple[Grey, NDArray[np.float64]]:
    height, width = picture.shape
    size = width * factor, height * factor
    large = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_CUBIC), np.uint8)
    return large, np.asarray((corners + 0.5) * factor - 0.5)


def moved(pixels: Grey, x: float, y: float) -> Grey:
    shift = np.array([[1.0, 0, x], [0, 1.0, y]])
    return np.asarray(
        cv2.warpAffine(pixels, shift, pixels.shape[::-1], borderMode=cv2.BORDER_REPLICATE), np.uint8
    )


@each_kind
@each_pose
def test_corners_are_exact_and_none_is_invented(name: str, pose: str) -> None:
    """The finder's corners are accurate to some tenths of a pixel, from markers and edges alone,
    and it finds nearly all that calib would find in the picture.
    """
    picture, truth = drawn(name, pose)
    detected = look(picture, KINDS[name].board)
    errors = off(detected.corners, truth)
    assert np.sqrt((errors**2).mean()) < 0.2
    assert errors.max() < 1
    full = find_board(picture, KINDS[name].board)
    assert isinstance(full, Detection)
    assert len(errors) >= 0.95 * np.isfinite(full.corners[:, 0]).sum()


@pytest.mark.parametrize("name", ["charuco", "aprilgrid"])
@each_pose
def test_large_pictures_are_searched_reduced_and_refined_in_full(name: str, pose: str) -> None:
    """At three times the picture's width, the finder reads the markers in blocks of two by two
    pixels.
    """
    picture, truth = enlarged(*drawn(name, pose), 3)
    finder = make_finder(KINDS[name].board)
    frame = Frame(picture, 0, 1.0)
    detected = finder.look(frame)
    assert np.sqrt((off(detected.corners, truth) ** 2).mean()) < 0.5, "px of the whole picture"
    refined = off(finder.refine(frame, detected), truth)
    assert np.sqrt((refined**2).mean()) < 0.3, "px; the picture was enlarged, and its grain with it"
    assert len(refined) >= len(off(detected.corners, truth)) - 2


def test_markers_too_small_for_the_reduced_picture_are_read_in_a_finer_one() -> None:
    """The markers of 22 px have cells of 1.8 px in blocks of two by two."""
    view = CHARUCO.view(
        np.array([0.2, 0.3, -0.5, 0.0, 0.0, 0.7]), lens=Lens(width=1000, height=300, focal=1000.0)
    )
    picture, truth = view.picture, view.corners
    assert len(off(look(picture, CHARUCO.board).corners, truth)) > 0.9 * CHARUCO.board.count


@pytest.mark.parametrize("name", ["charuco", "aprilgrid"])
@pytest.mark.parametrize("added", [0.0, 0.8, 1.6])
def test_blur_is_measured_in_px(name: str, added: float) -> None:
    """Oracle: normal blurs add their variances; the pictures' own is 0.7 px and the pixel's
    square.
    """
    picture = enlarged(*drawn(name), 1)[0]
    detected = look(
        np.asarray(cv2.GaussianBlur(picture, (0, 0), added), np.uint8) if added else picture,
        KINDS[name].board,
    )
    if detected.corners is None:
        assert added > 1, "its markers cannot be read any more"
        return
    assert detected.blur
    assert detected.blur.sigma == pytest.approx((0.7**2 + 1 / 12 + added**2) ** 0.5, abs=0.1)
    assert detected.blur.streak < 1.5


@pytest.mark.parametrize("name", ["charuco", "aprilgrid"])
@pytest.mark.parametrize("angle", np.linspace(0, np.pi, 5)[:-1])
def test_a_streak_is_measured_in_any_direction(name: str, angle: float) -> None:
    picture, _ = enlarged(*drawn(name), 2)
    passing = [
        moved(picture, *(4 * step * np.array([np.cos(angle), np.sin(angle)])))
        for step in np.linspace(-0.5, 0.5, 21)
    ]
    streaked = np.asarray(np.mean(passing, 0).round(), np.uint8)
    detected = look(streaked, KINDS[name].board)
    assert detected.blur
    assert detected.blur.streak == pytest.approx(4.0, abs=1.0)  # its spread is no normal blur's
    assert sentence(streaked, KINDS[name].board) == MOTION_BLUR


@pytest.mark.parametrize("name", ["charuco", "aprilgrid"])
@each_pose
def test_the_gate_keeps_a_good_view_once(name: str, pose: str) -> None:
    picture, _ = drawn(name, pose)
    board = KINDS[name].board
    current, previous = look(picture, board), look(picture, board, 0.9)
    assert judge_frame(current, previous, ()).sentence == GOOD_VIEW
    assert judge_frame(current, None, ()).sentence == HOLD_STILL
    assert judge_frame(look(moved(picture, 2.5, 0), board), previous, ()).sentence == MOVING
    assert current.corners is not None
    assert judge_frame(current, previous, [current.corners]).sentence == KNOWN_VIEW
    second, _ = drawn(name, "partial" if pose == "whole" else "whole")
    elsewhere = look(second, board).corners
    assert elsewhere is not None
    assert judge_frame(current, previous, [elsewhere]).sentence == GOOD_VIEW


def test_a_view_that_shows_what_a_hand_hid_is_new() -> None:
    picture, truth = drawn("charuco")
    hidden = picture.copy()
    hidden[:, int(truth[:, 0].mean()) :] = 120
    half, full = look(hidden, CHARUCO.board), look(picture, CHARUCO.board)
    assert half.corners is not None
    assert full.corners is not None
    assert judge_frame(full, full, [half.corners]).sentence != KNOWN_VIEW
    assert judge_frame(half, half, [full.corners]).sentence == KNOWN_VIEW


@pytest.mark.parametrize("name", ["charuco", "aprilgrid"])
def test_light_and_focus_are_judged(name: str) -> None:
    picture, _ = drawn(name)
    board = KINDS[name].board
    assert sentence(np.asarray(np.minimum(picture * 1.6, 255), np.uint8), board) == GLARE
    assert sentence(np.asarray(picture * 0.15, np.uint8), board) == DARK
    large, _ = enlarged(picture, truth_of(name), 3)
    assert (
        sentence(np.asarray(cv2.GaussianBlur(large, (0, 0), 1.0), np.uint8), board) == OUT_OF_FOCUS
    ), "2.1 px of its own, enlarged, and more"


def truth_of(name: str) -> NDArray[np.float64]:
    return drawn(name)[1]


def test_too_small_a_part_of_the_board_is_reported() -> None:
    """Return two markers and the corners around them."""
    picture, truth = drawn("charuco")
    grid = truth.reshape(6, 9, 2)
    covered = np.full_like(picture, 120)
    low, high = grid[:2, :2].reshape(-1, 2).min(0), grid[:2, :2].reshape(-1, 2).max(0)
    around = (high - low).max()
    (x_min, top), (right, bottom) = (
        (low - 1.2 * around).astype(int),
        (high + 0.3 * around).astype(int),
    )
    area = np.s_[max(top, 0) : bottom, max(x_min, 0) : right]
    covered[area] = picture[area]
    text = sentence(covered, CHARUCO.board)
    assert "show more of" in text


MISTAKES: dict[str, tuple[str, Callable[[Board], Board], str]] = {
    "dictionary": (
        "charuco",
        lambda _: CHARUCO.with_coding(dictionary="DICT_6X6_250"),
        "show markers of DICT_4X4_50 with a black border",
    ),
    "marker": ("charuco", lambda _: CHARUCO.with_coding(marker=0.01), "correct board.marker_mm"),
    "columns": ("charuco", lambda board: replace(board, columns=10), "write board.columns: 9"),
    "legacy": (
        "legacy",
        lambda _: LEGACY.with_coding(legacy_pattern=False),
        "write board.legacy_pattern: true",
    ),
    "rows": (
        "charuco",
        lambda board: replace(board, rows=4),
        "are seen, where a 9x4 ChArUco board has 0 to 24",
    ),
    "tags": ("aprilgrid", lambda board: replace(board, columns=10), "write board.columns: 6"),
    "spacing": (
        "aprilgrid",
        lambda _: GRID.with_coding(spacing=0.25),
        "0.30 of their side apart, where 0.25 is declared",
    ),
    "other type": (
        "aprilgrid",
        lambda _: CHARUCO.board,
        "show markers of DICT_APRILTAG_36h11 with a black border of two cells",
    ),
}


@pytest.mark.parametrize(
    "mistake",
    [
        pytest.param(mistake, marks=pytest.mark.slow if name == "dictionary" else ())
        for name, mistake in MISTAKES.items()
    ],
    ids=MISTAKES.keys(),
)
def test_another_board_than_the_declared_one_is_named(
    mistake: tuple[str, Callable[[Board], Board], str],
) -> None:
    name, change, says = mistake
    text = sentence(drawn(name)[0], change(KINDS[name].board))
    assert says in text
    assert text[0].isupper()
    assert text.endswith(".")
    assert not text.endswith("..")


@pytest.mark.parametrize("name", ["charuco", "aprilgrid"])
def test_a_mirrored_board_is_reported(name: str) -> None:
    assert "can be read only in a mirror" in sentence(
        np.ascontiguousarray(drawn(name)[0][:, ::-1]), KINDS[name].board
    )


@pytest.mark.slow
def test_two_boards_or_a_repeated_marker_are_reported() -> None:
    pose = np.array([0, 0, 0, 0, 0, 0.38])
    pair = np.hstack([CHARUCO.view(pose).picture, CHARUCO.view(pose, seed=2).picture])
    assert "is seen twice: show one board alone" in sentence(pair, CHARUCO.board)
    pieces = np.hstack(
        [pair[:, :240], np.full((360, 100), 150, np.uint8), pair[:, 720:]]
    )  # of no marker two
    assert "do not lie as on one 9x6 ChArUco board" in sentence(pieces, CHARUCO.board)


def test_another_target_is_reported_until_the_board_appears(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The search for another board rests meanwhile: it takes as long as many frames."""
    searches = []

    def other(*_: object) -> str:
        searches.append(0)
        return "They are others."

    monkeypatch.setattr("capture.coded_finder.other_coding", other)
    monkeypatch.setattr("capture.coded_finder.REST_RATIO", 1e9)
    finder, wall = CodedFinder(CHARUCO.board), np.full((360, 480), 120, np.uint8)
    for _ in range(3):
        assert finder.look(Frame(wall, 0, 1.0)).problem == "They are others"
    assert len(searches) == 1
    assert finder.look(Frame(drawn("charuco")[0], 0, 1.0)).corners is not None
    assert "no marker of the 9x6 ChArUco board found" in finder.look(Frame(wall, 0, 1.0)).problem


@pytest.mark.parametrize("name", ["charuco", "aprilgrid"])
@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (3, 2000), (480, 640), (481, 643, 3)])
@pytest.mark.parametrize("level", [0, 255])
def test_pictures_of_nothing(name: str, shape: tuple[int, ...], level: int) -> None:
    detected = look(np.full(shape, level, np.uint8), KINDS[name].board)
    assert detected.corners is None
    assert "no marker of" in detected.problem


ASKED = {
    "charuco": (
        "--type",
        "charuco",
        "--board",
        "9x6",
        "--square-mm",
        "20",
        "--marker-mm",
        "15",
        "--dictionary",
        "DICT_4X4_250",
    ),
    "legacy": (
        *(
            "--type",
            "charuco",
            "--board",
            "6x7",
            "--square-mm",
            "25",
            "--marker-mm",
            "17.5",
            "--dictionary",
            "DICT_5X5_100",
        ),
        "--legacy-pattern",
    ),
    "aprilgrid": ("--type", "aprilgrid", "--board", "6x6", "--tag-mm", "24", "--spacing", "0.3"),
}


def recording(folder: Path, name: str) -> Path:
    """Photographs of three poses, of which two show a board that reaches out of the picture; the
    first is there twice.
    """
    folder.mkdir()
    for pose in ("whole", "partial"):
        cv2.imwrite(str(folder / f"{pose}.png"), drawn(name, pose)[0])
        cv2.imwrite(
            str(folder / f"{pose}-turned.png"),
            np.ascontiguousarray(drawn(name, pose)[0][::-1, ::-1]),
        )
    shutil.copy(folder / "whole.png", folder / "whole-again.png")
    return folder


@pytest.mark.parametrize("name", ASKED)
def test_photographs_of_a_board_with_markers_are_recorded(name: str, tmp_path: Path) -> None:
    source = recording(tmp_path / "photos", name)
    session = tmp_path / "session"
    done = capture("record", session, "--source", f"folder:{source}", *ASKED[name])
    assert done.returncode == 0, done.stderr
    session_read = read_session(session)
    assert str(session_read.board) == str(KINDS[name].board)
    assert session_read.board.points() == pytest.approx(KINDS[name].board.points())
    assert (name == "legacy") == ("legacy_pattern: true" in (session / "session.yaml").read_text())
    assert len(session_read.frames) == 4, done.stderr
    assert "This view is already there" in done.stderr
    second_run = capture("record", session, "--source", f"folder:{source}")
    assert second_run.returncode == 3, (
        "the session goes on, with its own board, and has all of these views"
    )
    wrong = capture(
        "record", session, "--source", f"folder:{source}", "--board", "9x6", "--square-mm", "20"
    )
    assert wrong.returncode == 2
    assert f"describes a board of {KINDS[name].board}, " in wrong.stderr


@pytest.mark.parametrize(
    ("left_out", "says"),
    [
        ("--marker-mm", "marker_mm is missing: write a number"),
        ("--dictionary", "dictionary is missing: write one of OpenCV's names"),
        ("--square-mm", "--board and --square-mm belong together"),
        ("--type", "marker_mm is not a known key"),
    ],
)
def test_a_board_that_is_half_described_is_refused(
    left_out: str, says: str, tmp_path: Path
) -> None:
    flags = list(ASKED["charuco"])
    place = flags.index(left_out)
    done = capture(
        "record",
        tmp_path / "session",
        "--source",
        f"folder:{tmp_path}",
        *flags[:place],
        *flags[place + 2 :],
    )
    assert done.returncode == 2
    assert says in done.stderr
    assert not (tmp_path / "session").exists()


def test_every_kind_has_its_finder() -> None:
    for kind in KINDS.values():
        assert isinstance(make_finder(kind.board), CodedFinder)
    assert not isinstance(make_finder(Board(9, 6, 0.02)), CodedFinder)
    assert LENS.width < 960, "drawn pictures are not reduced"
