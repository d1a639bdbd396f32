"""Boards with markers in rendered pictures, whose corners are known."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.corners import misprint
from calib.corners.detection import Detection, NotFound
from calib.corners.find import find_board
from calib.corners.lattice import Lattice, edge_normals
from calib.corners.markers import Markers, check_aruco, marker_places, read_markers
from calib.errors import InputError
from calib.session.board import Board
from calib.session.coding import Charuco
from fixtures.coded_boards import CHARUCO, GRID, KINDS, LENS, PARTIAL, WHOLE, Kind
from fixtures.coded_pictures import Lens

each_kind = pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS.keys())


def found_in(picture: NDArray, board: Board) -> Detection:
    detection = find_board(picture, board)
    assert isinstance(detection, Detection), detection
    return detection


def refused(picture: NDArray, board: Board) -> str:
    detection = find_board(picture, board)
    assert isinstance(detection, NotFound)
    return detection.reason


def inside(corners: NDArray, lens: Lens = LENS, margin: float = 6.0) -> NDArray[np.bool_]:
    return np.asarray(
        ((corners >= margin) & (corners <= np.array([lens.width, lens.height]) - 1 - margin)).all(1)
    )


@each_kind
def test_points_are_the_sheets_corners(kind: Kind) -> None:
    """Numbered alike, from the upper left; to a nanometre."""
    assert np.abs(kind.board.points() - kind.print.corners).max() < 1e-9
    assert np.allclose(kind.board.half, kind.print.corners.max(0))


@each_kind
def test_markers_lie_where_the_board_declares(kind: Kind) -> None:
    """Oracle: OpenCV reads the rendered sheet, seen straight, 2 px to a mm.

    Its outlines are half a pixel inside.
    """
    assert kind.board.coding
    size = int(2e3 * max(kind.board.half) * 2.8)
    lens = Lens(size, size, 400.0)
    drawn = kind.view(np.array([0, 0, 0, 0, 0, 0.2]), lens=lens)
    read = read_markers(
        drawn.picture,
        kind.board.coding.dictionary,
        1 if isinstance(kind.board.coding, Charuco) else 2,
    )
    places = marker_places(kind.board)
    assert sorted(read.numbers.tolist()) == list(range(len(places)))
    error = read.corners - (places[read.numbers] * 2e3 + (size - 1) / 2)
    assert np.abs(error).max() < 5, "px; the next corner of a marker is 28 px away and more"


@each_kind
@pytest.mark.parametrize("pose", [WHOLE, PARTIAL], ids=["whole", "partial"])
def test_corners_are_measured_at_their_true_places(kind: Kind, pose: NDArray) -> None:
    """At 1.5 grey levels of noise the bound of the pixels is some thousandths of a pixel.

    Nothing outside of the picture is made up.
    """
    drawn = kind.view(pose)
    detection = found_in(drawn.picture, kind.board)
    visible = np.isfinite(detection.corners[:, 0])
    assert visible[inside(drawn.corners)].mean() > 0.9
    assert inside(drawn.corners[visible], margin=0).all()
    assert (visible.mean() > 0.97) == (pose is WHOLE)
    error = detection.corners[visible] - drawn.corners[visible]
    assert np.sqrt((error**2).sum(-1).mean()) < 0.02
    assert np.linalg.norm(error, axis=-1).max() < 0.1
    assert np.abs(error.mean(0)).max() < 0.005, "no bias"
    assert np.isfinite(detection.covariances[visible]).all()
    assert np.array_equal(np.isfinite(detection.blurs).all(1), visible)
    assert np.median(detection.blurs[visible]) == pytest.approx(np.hypot(0.7, 12**-0.5), rel=0.05)
    scaled = (
        np.einsum("ni,nij,nj->n", error, np.linalg.inv(detection.covariances[visible]), error) / 2
    )
    assert 0.5 < np.median(scaled) / np.log(2) < 2.5, (
        "the squared error over the variance that is said"
    )


@each_kind
def test_edges_bend_as_the_lens_bends_them(kind: Kind) -> None:
    """The lattice's curvatures against those of the projected lines, by differences: a mistake of
    1e-4 1/px moves a corner whose edges are 17 px long by 0.005 px. A fit of second order is off by
    4e-5 to 6e-5 at a board's rim, this one by 0.9e-5 to 2.0e-5.
    """
    points = np.column_stack([kind.board.points(), np.zeros(kind.board.count)])
    size = 1e-3  # m

    def projected(shift: NDArray) -> NDArray:
        moved = cv2.projectPoints(
            points + shift, WHOLE[:3], WHOLE[3:], LENS.matrix, np.array(LENS.distortion)
        )[0]
        return np.asarray(moved, np.float64).reshape(-1, 2)

    middle, result = (
        projected(np.zeros(3)),
        Lattice.from_corners(projected(np.zeros(3)), kind.board),
    )
    for edge, axis in enumerate(np.eye(3)[:2] * size):
        ahead, behind = projected(axis), projected(-axis)
        step, bend = (ahead - behind) / 2, ahead - 2 * middle + behind
        true = (edge_normals(step) * bend).sum(-1) / (step**2).sum(-1)
        error = np.abs(result.curvatures[:, edge] - true)
        assert error.max() < 3e-5


@each_kind
def test_hidden_corners_are_not_invented(kind: Kind) -> None:
    """A grey hand over the middle: what it covers is NaN, what is around it is where it is."""
    drawn = kind.view(WHOLE)
    picture = drawn.picture.copy()
    picture[130:230, 180:300] = 120
    detection = found_in(picture, kind.board)
    visible = np.isfinite(detection.corners[:, 0])
    hidden = ((drawn.corners > [180, 130]) & (drawn.corners < [299, 229])).all(1)
    assert hidden.sum() > 5
    assert not visible[hidden].any()
    assert np.linalg.norm(detection.corners[visible] - drawn.corners[visible], axis=1).max() < 0.2
    assert visible.sum() > 0.5 * (~hidden).sum()


@pytest.mark.parametrize("kind", [CHARUCO, GRID], ids=["charuco", "aprilgrid"])
def test_a_wrong_number_is_not_believed(kind: Kind) -> None:
    """One marker is covered by a picture of another one of the board, itself covered: it is read,
    and no corner moves.
    """
    drawn = kind.view(WHOLE)
    places = cv2.perspectiveTransform(
        marker_places(kind.board).reshape(-1, 1, 2), _homography(kind, drawn.corners)
    ).reshape(-1, 4, 2)
    picture = drawn.picture.copy()
    count = len(places)
    taken, covered = count // 2, count // 2 + 2
    corners = places[[covered, taken]].astype(np.float32)
    onto = cv2.getPerspectiveTransform(corners[1], corners[0])
    copy = cv2.warpPerspective(drawn.picture, onto, picture.shape[::-1])
    masks = [
        cv2.fillConvexPoly(np.zeros_like(picture), place.astype(np.int32), 1.0) > 0
        for place in places[[covered, taken]]
    ]
    covered_mask, gone = masks
    picture = np.where(gone, 120, np.where(covered_mask, copy, picture)).astype(np.uint8)
    assert kind.board.coding
    read = read_markers(picture, kind.board.coding.dictionary, 1 if kind is CHARUCO else 2)
    assert (read.numbers == taken).sum() == 1
    assert (read.numbers == covered).sum() == 0
    detection = found_in(picture, kind.board)
    visible = np.isfinite(detection.corners[:, 0])
    assert visible.sum() > 0.8 * kind.board.count
    assert np.linalg.norm(detection.corners[visible] - drawn.corners[visible], axis=1).max() < 0.3


def _homography(kind: Kind, corners: NDArray) -> NDArray:
    return np.asarray(cv2.findHomography(kind.board.points(), corners)[0])


def test_two_boards_and_a_repeated_marker_are_refused() -> None:
    pose = np.array([0, 0, 0, 0, 0, 0.5])
    picture = np.hstack([CHARUCO.view(pose).picture, CHARUCO.view(pose, seed=2).picture])
    assert "is seen twice: show one board alone" in refused(picture, CHARUCO.board)
    left_edge, right = picture[:, :240], picture[:, 720:]
    halves = np.hstack([left_edge, np.full((360, 100), 150, np.uint8), right])
    assert "do not lie as on one 9x6 ChArUco board" in refused(halves, CHARUCO.board)


MISTAKES: dict[str, tuple[Kind, Callable[[Board], Board], str]] = {
    "too few rows": (
        CHARUCO,
        lambda board: replace(board, rows=4),
        "numbers up to 34 are seen, where a 9x4 ChArUco board has 0 to 24",
    ),
    "a row too few": (
        CHARUCO,
        lambda board: replace(board, rows=5),
        "5 markers are seen beyond the last row of the 9x5 ChArUco board",
    ),
    "a row of tags too few": (
        GRID,
        lambda board: replace(board, rows=10),
        "up to 35 are seen, where a 6x5 AprilGrid",
    ),
    "a row too few, legacy": (
        KINDS["legacy"],
        lambda board: replace(board, rows=6),
        "beyond the last row|do not lie as on one 6x6",
    ),
    "columns": (
        CHARUCO,
        lambda board: replace(board, columns=8),
        "do not lie as on one 8x6 ChArUco board|numbers up to 34",
    ),
    "tags": (
        GRID,
        lambda board: replace(board, columns=14),
        "do not lie as on one 7x6 AprilGrid board",
    ),
    "marker": (
        CHARUCO,
        lambda board: replace(board, coding=Charuco(0.012, "DICT_4X4_250")),
        "do not lie as on one 9x6",
    ),
    "marker a little": (
        CHARUCO,
        lambda board: replace(board, coding=Charuco(0.0125, "DICT_4X4_250")),
        "lie not|correct board.marker_mm",
    ),
    "spacing": (
        GRID,
        lambda _: GRID.with_coding(spacing=0.25),
        "0.30 of their side apart, where 0.25 is declared",
    ),
    "dictionary": (
        CHARUCO,
        lambda _: CHARUCO.with_coding(dictionary="DICT_6X6_250"),
        "no marker of the 9x6 ChArUco board",
    ),
    "legacy": (
        KINDS["legacy"],
        lambda _: KINDS["legacy"].with_coding(legacy_pattern=False),
        "do not lie as on one 6x7 ChArUco",
    ),
}


@pytest.mark.parametrize(
    ("kind", "distance"), [(GRID, 0.45), (CHARUCO, 0.5)], ids=["aprilgrid", "charuco"]
)
def test_small_markers_are_read_in_the_enlarged_picture(kind: Kind, distance: float) -> None:
    """Cells of 2.4 and 2.1 px, and a blur of 1 px: 9 of 36 and 8 of 35 markers are read in the
    picture as it is, and with what is beside them they tell 0.74 and 0.48 of the corners.
    """
    drawn = kind.view(np.array([0.2, -0.3, 0.4, 0.0, 0.0, distance]), blur=1.0)
    detection = found_in(drawn.picture, kind.board)
    error = np.linalg.norm(detection.corners - drawn.corners, axis=1)
    assert np.isfinite(error).mean() > 0.95
    assert np.nanmax(error) < 0.1  # 0.052 and 0.056 were measured


@pytest.mark.parametrize("mistake", MISTAKES.values(), ids=MISTAKES.keys())
def test_a_board_that_is_not_the_declared_one_is_refused(
    mistake: tuple[Kind, Callable[[Board], Board], str],
) -> None:
    kind, change, says = mistake
    reason = refused(kind.view(WHOLE).picture, change(kind.board))
    assert any(words in reason for words in says.split("|")), reason


def test_outlines_inside_of_the_tags_do_not_refuse_a_board(monkeypatch: pytest.MonkeyPatch) -> None:
    """OpenCV's outlines of tags of 41 px lay 3 px inside: the gaps seemed to be 0.37 of a tag, and
    the picture was refused. The corners themselves show 0.300.
    """

    def shrink(markers: Markers, board: Board, _: NDArray[np.uint8]) -> NDArray[np.float64]:
        middles = markers.corners.mean(1, keepdims=True)
        outlines = middles + 0.9 * (markers.corners - middles)
        corners = np.full((board.count, 2), np.nan)
        places = marker_places(board)[markers.numbers].reshape(-1, 1, 2)
        indices = np.linalg.norm(board.points() - places, axis=-1).argmin(1)
        corners[indices] = outlines.reshape(-1, 2)
        return corners

    monkeypatch.setattr(misprint, "refine_tag_outlines", shrink)
    drawn = GRID.view(WHOLE)
    detection = found_in(drawn.picture, GRID.board)
    error = np.linalg.norm(detection.corners - drawn.corners, axis=1)
    assert np.nanmax(error) < 0.1


def test_a_mirrored_picture_shows_no_marker() -> None:
    for kind in (CHARUCO, GRID):
        reason = refused(np.ascontiguousarray(kind.view(WHOLE).picture[:, ::-1]), kind.board)
        assert "no marker of" in reason or "no two markers lie" in reason, (
            "one or two may be read by accident"
        )


def test_sixteen_bits_are_measured_as_such() -> None:
    drawn = CHARUCO.view(WHOLE)
    fine = found_in(drawn.picture.astype(np.uint16) * 200 + 1000, CHARUCO.board)
    coarse = found_in(drawn.picture, CHARUCO.board)
    assert np.abs(fine.corners - coarse.corners).max() < 0.02


def test_an_opencv_without_aruco_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(cv2, "aruco")
    with pytest.raises(InputError, match="has no aruco module"):
        check_aruco()
