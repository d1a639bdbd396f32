"""The guides: where to hold the board next, and when the views are enough."""

from dataclasses import replace
from itertools import product

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from calib.errors import InputError
from calib.planning.design import MAX_PLANNED_VIEWS, Design
from calib.planning.hints import placement_hint
from calib.planning.pose_bank import (
    Reach,
    fit_bare_pose,
    make_pose_bank,
    outline,
    outline_corners,
    project_bare,
)
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.coding import Charuco
from calib.session.schema import Number
from capture.coverage import (
    COVERAGE_CELLS,
    InformedGuide,
    KeptView,
    PlainGuide,
    covered_cells,
    upright,
)
from capture.finders import make_finder
from capture.frames import Frame
from fixtures.coded_boards import CHARUCO, GRID, LENS, Kind

Array = NDArray[np.float64]

BOARD = Board(9, 7, 0.02)
CAMERA = Camera(
    1640, 1232, intrinsics=Intrinsics(Number(1280.0), Number(1280.0), Number(830.0), Number(620.0))
)
BARREL = Camera(
    1640,
    1232,
    intrinsics=Intrinsics(
        Number(1000.0),
        Number(1000.0),
        Number(830.0),
        Number(620.0),
        tuple(map(Number, (-0.25, 0.05, 0, 0))),
    ),
)
CODED = replace(BOARD, coding=Charuco(0.015, "DICT_4X4_250"))
REACH = Reach(0.4, 1.0)
SIZE = CAMERA.width, CAMERA.height
ENDS = tuple(product((0, SIZE[0]), (0, SIZE[1])))

each_camera = pytest.mark.parametrize(
    "camera", [CAMERA, BARREL, Camera(1640, 1232)], ids=["pinhole", "barrel", "unknown"]
)


@each_camera
def test_every_pose_of_the_bank_is_within_reach_and_picture(camera: Camera) -> None:
    candidates = make_pose_bank(BOARD, camera, REACH)
    assert 200 < len(candidates.poses) < 500
    assert (candidates.corners > 10).all()
    assert (candidates.corners < np.array(SIZE) - 11).all()
    assert (candidates.poses[:, 5] >= 0.4 - 1e-9).all()
    assert (candidates.poses[:, 5] <= 1.0 + 1e-9).all()


@each_camera
def test_the_bank_reaches_into_every_corner_of_the_picture(camera: Camera) -> None:
    candidates = make_pose_bank(BOARD, camera, REACH)
    for corner in product((0, SIZE[0]), (0, SIZE[1])):
        assert (
            np.linalg.norm(candidates.corners.reshape(-1, 2) - corner, axis=1).min() < 0.1 * SIZE[0]
        )


def test_a_board_that_never_fits_into_the_picture_is_reported() -> None:
    with pytest.raises(
        InputError,
        match=r"does not fit .* anywhere between 0\.05 and 0\.06 m: hold it farther away",
    ):
        PlainGuide(BOARD, CAMERA, Reach(0.05, 0.06))


def test_the_reach_of_a_board_lets_it_fill_the_picture_and_a_quarter() -> None:
    reach = Reach.of(BOARD, CAMERA)
    for depth, share in ((reach.near, 0.75), (reach.far, 0.25)):
        visible = project_bare(BOARD, CAMERA, np.array([0, 0, 0, 0, 0, depth]))
        assert np.ptp(visible[:, 0]) == pytest.approx(share * SIZE[1])


def test_the_outline_goes_once_around() -> None:
    around = BOARD.points()[outline_corners(BOARD)]
    x, y = around.T
    assert len(around) == 2 * (9 + 7) - 4
    assert abs(np.dot(x, np.roll(y, 1)) - np.dot(y, np.roll(x, 1))) / 2 == pytest.approx(
        8 * 6 * 0.02**2
    )


def test_a_pose_is_found_from_its_corners() -> None:
    pose = np.array([0.3, -0.2, 0.1, 0.05, -0.02, 0.6])
    estimate = fit_bare_pose(BOARD, BARREL, project_bare(BOARD, BARREL, pose))
    assert estimate == pytest.approx(pose, abs=1e-4)


@pytest.mark.parametrize("in_plane", [0, 90, 180, 270])
@pytest.mark.parametrize(("horizontal", "vertical"), list(product((-1, 0, 1), repeat=2)))
def test_the_tilt_in_words_names_the_far_side(
    horizontal: int, vertical: int, in_plane: int
) -> None:
    """Oracle: the depths of points on the board, to the left and right of its middle and above and
    below it in the picture.
    """
    tilt = cv2.Rodrigues(np.radians(25) * np.array([vertical, -horizontal, 0.0]))[0]
    turn = tilt @ cv2.Rodrigues(np.radians(in_plane) * np.array([0, 0, 1.0]))[0]
    pose = np.concatenate([cv2.Rodrigues(turn)[0].ravel(), [0, 0, 0.6]])
    points = BOARD.points() @ turn[:, :2].T
    is_far = points[:, 2] > 0.01
    text = placement_hint(pose, project_bare(BOARD, CAMERA, pose), SIZE, None, (0.4, 1.0))
    assert ("right" in text) == bool(horizontal and points[is_far][:, 0].mean() > 0)
    assert ("left" in text) == bool(horizontal and points[is_far][:, 0].mean() < 0)
    assert ("bottom" in text) == bool(vertical and points[is_far][:, 1].mean() > 0)
    assert ("top" in text) == bool(vertical and points[is_far][:, 1].mean() < 0)
    assert ("facing the camera" in text) == (not horizontal and not vertical)


@pytest.mark.parametrize(
    ("x", "y", "place"),
    [
        (-0.2, 0, "to the left edge"),
        (0.2, 0, "to the right edge"),
        (0, -0.14, "to the top edge"),
        (0.2, 0.14, "to the bottom right corner"),
    ],
)
def test_the_place_is_named(x: float, y: float, place: str) -> None:
    pose = np.array([0, 0, 0, x, y, 0.5])
    assert place in placement_hint(pose, project_bare(BOARD, CAMERA, pose), SIZE, None, (0.4, 1.0))


def test_distance_in_words_is_relative_to_the_current_board() -> None:
    pose = np.array([0, 0, 0, 0, 0, 0.6])
    near = np.array([0, 0, 0, 0, 0, 0.4])
    far = np.array([0, 0, 0, 0, 0, 1.0])
    outline = project_bare(BOARD, CAMERA, pose)
    assert (
        placement_hint(pose, outline, SIZE, far, (0.4, 1.0))
        == "closer, in the middle, facing the camera"
    )
    assert (
        placement_hint(pose, outline, SIZE, far, (0.4, 1.0))
        == "closer, in the middle, facing the camera"
    )
    assert (
        placement_hint(pose, outline, SIZE, near, (0.4, 1.0))
        == "farther away, in the middle, facing the camera"
    )
    assert (
        placement_hint(pose, outline, SIZE, pose, (0.4, 1.0)) == "in the middle, facing the camera"
    )
    assert placement_hint(near, outline, SIZE, None, (0.4, 1.0)).startswith("near (40 cm)")
    assert placement_hint(far, outline, SIZE, None, (0.4, 1.0)).startswith("far (1.0 m)")


@pytest.mark.parametrize(
    ("x", "y", "place"),
    [
        (-0.3, 0, "over the left edge (a part outside)"),
        (0, 0.23, "over the bottom edge (a part outside)"),
        (0.3, -0.23, "over the top right corner (a part outside)"),
    ],
)
def test_a_board_that_reaches_out_of_the_picture_is_described_so(
    x: float, y: float, place: str
) -> None:
    pose = np.array([0, 0, 0, x, y, 0.5])
    """The corners outside the picture are where the other corners of the board put them."""
    around = outline(project_bare(CODED, CAMERA, pose), CODED)
    assert place in placement_hint(pose, around, SIZE, None, (0.4, 1.0))
    plain = project_bare(BOARD, CAMERA, pose)[outline_corners(BOARD)]
    assert around == pytest.approx(plain, abs=1e-3), (
        "px; without a lens, a plane through what is seen is the board"
    )


def test_a_lens_that_folds_back_shows_no_corner_that_is_outside() -> None:
    """The polynomial turns back at 0.9 from the middle, and would map a point at 1.5 into the
    picture again.
    """
    lens = Intrinsics(
        Number(600.0),
        Number(600.0),
        Number(820.0),
        Number(616.0),
        tuple(map(Number, (-0.4, 0, 0, 0))),
    )
    folding = replace(CAMERA, intrinsics=lens)
    visible = project_bare(CODED, folding, np.array([0, 0, 0, 0.75, 0, 0.5]))
    assert np.isnan(visible).all()


def _distances_to_ends(corners: Array) -> list[float]:
    """Return px, the distance of the nearest corner to each of the picture's corners."""
    points = corners.reshape(-1, 2)
    visible = points[~np.isnan(points[:, 0])]
    return [float(np.linalg.norm(visible - end, axis=1).min()) for end in ENDS]


@each_camera
def test_the_bank_of_a_board_with_markers_reaches_out_of_the_picture(camera: Camera) -> None:
    """The bank of a board with markers has all poses of a checkerboard's, and others that reach out
    of the picture by useful amounts.
    """
    candidates, plain = make_pose_bank(CODED, camera, REACH), make_pose_bank(BOARD, camera, REACH)
    visible = np.isfinite(candidates.corners[..., 0])
    assert len(candidates.poses) > 1.4 * len(plain.poses)
    assert visible.mean(1).min() >= 0.4
    reaching = ~visible.all(1)
    assert 0.25 < reaching.mean() < 0.7
    interior = candidates.corners[visible]
    assert (interior > 0).all()
    assert (interior < np.array(SIZE) - 1).all()
    nearest = _distances_to_ends(candidates.corners)
    complete = _distances_to_ends(plain.corners)
    assert max(nearest) < 0.5 * min(complete), (
        "px: a cover bends most in the corners of the picture"
    )


@pytest.mark.parametrize(
    "kind",
    [CHARUCO, pytest.param(GRID, marks=pytest.mark.slow)],
    ids=["charuco", "aprilgrid"],
)
def test_boards_in_the_poses_of_the_bank_can_be_detected(kind: Kind) -> None:
    """Poses of the bank that reach out of the picture, drawn small and so not tilted about both
    axes: the live finder sees most corners that the bank counts on, where the bank has them.
    """
    k, board = LENS.matrix, kind.board
    lens = Intrinsics(
        Number(k[0, 0]),
        Number(k[1, 1]),
        Number(k[0, 2]),
        Number(k[1, 2]),
        tuple(map(Number, LENS.distortion[:4])),
    )
    camera = Camera(LENS.width, LENS.height, intrinsics=lens)
    candidates = make_pose_bank(board, camera, Reach.of(board, camera))
    near, simple = (
        candidates.poses[:, 5] < np.median(candidates.poses[:, 5]),
        (candidates.poses[:, :2] != 0).sum(1) < 2,
    )
    reaching = np.flatnonzero(np.isnan(candidates.corners[..., 0]).any(1) & near & simple)
    counted, distances = 0, []
    for pose in np.random.default_rng(4).choice(reaching, 4, replace=False):
        sighting = make_finder(board).look(Frame(kind.view(candidates.poses[pose]).picture, 0, 1.0))
        assert sighting.corners is not None, sighting.problem
        error = np.linalg.norm(sighting.corners - candidates.corners[pose], axis=1)
        counted += int(np.isfinite(candidates.corners[pose, :, 0]).sum())
        distances.append(error[np.isfinite(error)])
    errors = np.concatenate(distances)
    assert len(errors) > 0.6 * counted
    assert np.mean(errors < 0.3) > 0.95, (
        "px; a tag of 25 px at the border is outlined wrongly now and then"
    )


def test_the_plain_rule_asks_for_the_borders_where_markers_allow() -> None:
    guide = PlainGuide(CODED, CAMERA, REACH)
    views: list[KeptView] = []
    text = []
    while (hint := guide.next_pose(views)) is not None:
        views.append(KeptView(project_bare(CODED, CAMERA, hint.pose)))
        text.append(hint.instruction)
        assert len(views) < 40
    for side in ("left", "right", "top", "bottom"):
        assert (
            sum(
                "a part outside" in placement_hint and side in placement_hint.split(" (a")[0]
                for placement_hint in text
            )
            >= 2
        )
    assert guide.progress(views).is_enough
    complete = [view for view in views if np.isfinite(view.corners).all()]
    assert complete
    assert not guide.progress(complete).is_enough
    assert guide.progress(complete).image.min() < guide.progress(views).image.min(), (
        "the outermost cells"
    )


def test_the_informed_guide_knows_views_of_a_part() -> None:
    """Two poses show one half of the board each: the view at one says nothing about the other."""
    candidates = make_pose_bank(CODED, CAMERA, REACH)
    tilted = (candidates.poses[:, :3] ** 2).sum(1) > 0
    leftmost = int(np.argmin(tilted + np.abs(candidates.poses[:, 3] + 1)))
    rightmost = int(np.argmin(tilted + np.abs(candidates.poses[:, 3] - 1)))
    corners = candidates.corners[[leftmost, rightmost]]
    assert np.isnan(corners).any((1, 2)).all()
    glass = np.zeros((*COVERAGE_CELLS, 2))
    spread = np.ones((*COVERAGE_CELLS, 2, 2, 2))
    information = np.array([np.diag([50.0, 0.0]), np.diag([0.0, 50.0])])
    design = Design(
        candidates.poses[[leftmost, rightmost]],
        corners,
        information,
        np.zeros((2, 2)),
        0,
        spread,
        np.array([0.7]),
        glass,
    )
    guide = InformedGuide(CODED, CAMERA, REACH, design)
    first = KeptView(corners[0])
    hint = guide.next_pose([first])
    assert hint
    assert hint.pose == pytest.approx(design.poses[1])
    assert np.isfinite(hint.outline).all()
    assert hint.outline[:, 0].max() > SIZE[0], "the frame goes on where the picture ends"
    assert guide.next_pose([first, KeptView(corners[1])]) is None


def test_covered_cells_are_the_outlines_area() -> None:
    box = np.array([[100.0, 200], [900, 200], [900, 1000], [100, 1000]])
    cells = covered_cells(box, CAMERA)
    assert cells.shape == COVERAGE_CELLS
    assert cells.mean() == pytest.approx(800 * 800 / (1640 * 1232), rel=0.03)
    assert cells[:, -4:].max() == 0


@pytest.mark.parametrize("quarters", [0, 1, 2, 3])
def test_a_square_board_held_upside_down_is_the_same_view(quarters: int) -> None:
    board = Board(7, 7, 0.02)
    corners = project_bare(board, CAMERA, np.array([0.2, 0.1, 0.05, 0, 0, 0.5]))
    turned = np.rot90(corners.reshape(7, 7, 2), quarters).reshape(-1, 2)
    assert upright(turned, board) == pytest.approx(corners)


def test_the_plain_rule_ends_and_repeats_no_view() -> None:
    guide = PlainGuide(BOARD, CAMERA, REACH)
    views: list[KeptView] = []
    first = guide.progress(views)
    assert not first.is_enough
    assert first.sigma_px is None
    while (hint := guide.next_pose(views)) is not None:
        assert (
            guide.progress(views).views_needed == first.views_needed - len(views)
            if first.views_needed
            else 0
        )
        views.append(KeptView(project_bare(BOARD, CAMERA, hint.pose), hint.pose))
        assert len(views) < 40
    last = guide.progress(views)
    assert last.is_enough
    assert last.views_needed == 0
    assert last.depth.min() == 1
    assert len({tuple(np.round(view.corners.ravel())) for view in views}) == len(views)


def test_the_plain_rule_needs_no_poses() -> None:
    guide = PlainGuide(BOARD, CAMERA, REACH)
    candidates = make_pose_bank(BOARD, CAMERA, REACH)
    posed = [
        KeptView(corners, pose)
        for corners, pose in zip(candidates.corners[::40], candidates.poses[::40], strict=True)
    ]
    unposed = [KeptView(view.corners) for view in posed]
    assert guide.progress(posed).views_needed == guide.progress(unposed).views_needed


@pytest.mark.parametrize("pose", [(0, 0, 0, 0, 0, 0.5), (0.5, 0, 0, 0, 0, 1.0)])
def test_the_same_view_again_and_again_is_never_enough(pose: tuple[float, ...]) -> None:
    guide = PlainGuide(BOARD, CAMERA, REACH)
    corners = project_bare(BOARD, CAMERA, np.array(pose, float))
    progress = guide.progress([KeptView(corners)] * 50)
    assert not progress.is_enough
    assert progress.image.mean() < 0.5
    assert sorted(progress.depth)[:2] == [0, 0]


def made_design(information: Array, spread: Array, views: int = 0) -> Design:
    """Return a design over a bank of this many poses, with the maps' derivatives at one depth, the
    same for both axes' pixels.
    """
    candidates = make_pose_bank(BOARD, CAMERA, REACH)
    chosen = np.linspace(0, len(candidates.poses) - 1, len(information)).astype(int)
    modes = information.shape[-1]
    at = np.zeros((*COVERAGE_CELLS, 2, 2, modes))
    at[..., 0, 0, :] = spread
    glass = np.stack(
        np.meshgrid(*(np.linspace(0.2, 0.8, n) for n in COVERAGE_CELLS), indexing="ij"), -1
    )
    return Design(
        candidates.poses[chosen],
        candidates.corners[chosen],
        information,
        np.zeros((modes, modes)),
        views,
        at,
        np.array([0.7]),
        glass,
    )


def test_the_informed_guide_asks_for_views_that_reduce_the_error_of_maps() -> None:
    """The first of two modes hardly moves the maps. One pose informs much about the first, another
    a little about the second.
    """
    design = made_design(
        np.array([np.diag([1e4, 0.0]), np.diag([0.0, 10.0]), np.diag([0.0, 5.0])]),
        np.array([0.01, 1.0]),
    )
    guide = InformedGuide(BOARD, CAMERA, REACH, design)
    hint = guide.next_pose([])
    assert hint
    assert hint.pose == pytest.approx(design.poses[1])
    assert hint.outline == pytest.approx(design.corners[1][outline_corners(BOARD)])


def test_the_predicted_error_is_the_one_of_the_linear_model() -> None:
    design = made_design(np.array([np.diag([3.0, 8.0])]), np.array([0.5, 2.0]))
    guide = InformedGuide(BOARD, CAMERA, REACH, design)
    assert guide.progress([]).sigma_px == pytest.approx(np.sqrt(0.5**2 + 2**2))
    once = guide.progress([KeptView(design.corners[0])])
    assert once.sigma_px == pytest.approx(np.sqrt(0.5**2 / 4 + 2**2 / 9))


def test_as_many_views_are_needed_as_are_then_taken() -> None:
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(60, 3, 8))
    design = made_design(10 * rows.transpose(0, 2, 1) @ rows, rng.normal(size=8))
    guide = InformedGuide(BOARD, CAMERA, REACH, design, target_px=0.1, folds_agree=True)
    views: list[KeptView] = []
    needed = guide.progress(views).views_needed
    assert needed
    assert 1 < needed < MAX_PLANNED_VIEWS
    for remaining in range(needed, 0, -1):
        progress = guide.progress(views)
        assert progress.views_needed == remaining
        assert not progress.is_enough
        hint = guide.next_pose(views)
        assert hint
        views.append(KeptView(project_bare(BOARD, CAMERA, hint.pose)))
    assert guide.progress(views).is_enough
    assert len({tuple(np.round(view.corners.ravel())) for view in views}) == needed


@pytest.mark.parametrize(
    ("agree", "enough", "text"),
    [(None, False, "still running"), (False, False, "do not agree"), (True, True, "Enough")],
)
def test_sure_maps_are_enough_only_where_folds_agree(
    agree: bool | None, enough: bool, text: str
) -> None:
    design = made_design(np.array([[[1.0]]]), np.array([0.05]))
    progress = InformedGuide(BOARD, CAMERA, REACH, design, folds_agree=agree).progress([])
    assert progress.is_enough is enough
    assert text in progress.sentence
    assert progress.image.min() == 1


def test_a_target_out_of_reach_is_reported() -> None:
    design = made_design(np.array([[[1e-9]]]), np.array([5.0]))
    progress = InformedGuide(BOARD, CAMERA, REACH, design, folds_agree=True).progress([])
    assert progress.views_needed is None
    assert not progress.is_enough
    assert "would not reach" in progress.sentence


def test_coverage_maps_stay_between_none_and_all() -> None:
    design = made_design(np.array([[[1.0]], [[2.0]]]), np.array([0.3]))
    progress = InformedGuide(BOARD, CAMERA, REACH, design).progress([KeptView(design.corners[0])])
    for piece in (progress.image, progress.depth, progress.glass):
        assert piece.min() >= 0
        assert piece.max() <= 1
    assert 0 < progress.glass.mean() < 0.5
    assert progress.glass[0].max() == 0  # the patch reaches beyond what the picture sees
