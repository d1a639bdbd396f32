"""Measuring in metres: against points that were put there, with sigmas that are what repetition
shows.
"""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calib.apply.measure import BoardPose, MeasuredPoints, Measurer, UnmeasuredReason
from calib.apply.measure_files import (
    Point,
    measure_at_depth,
    read_points,
    read_poses,
    views_in_each_order,
)
from calib.calibration import Calibration
from calib.cli import main
from calib.corners.view import View
from calib.errors import InputError, NotEnoughDataError
from calib.session.schema import Number
from fixtures.known import known, lens_alone
from fixtures.synthetic import HEIGHT, WIDTH, Scene, scene

POSES = np.array([[0.3, -0.2, 0.1, 0.05, 0.02, 0.6], [-0.35, 0.25, 0.2, -0.08, 0.03, 0.5]])
NOISE = 0.1
REPEATS = 20


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(1, views=2, grid=(8, 8), amplitude=3e-5)


@pytest.fixture(scope="module")
def calibration(made: Scene) -> Calibration:
    return known(made, WIDTH, HEIGHT)


def placed(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """(N, 3) m in a board's frame to the camera's."""
    return np.asarray(points @ cv2.Rodrigues(pose[:3])[0].T + pose[3:])


def seen(calibration: Calibration, pose: np.ndarray, points: np.ndarray) -> np.ndarray:
    return calibration.project(placed(points, pose))


def view_of(
    calibration: Calibration, pose: np.ndarray, rng: np.random.Generator | None = None
) -> View:
    points = np.column_stack([calibration.board.points(), np.zeros(calibration.board.count)])
    pixels = seen(calibration, pose, points)
    if rng:
        pixels = pixels + rng.normal(0, NOISE / 2**0.5, pixels.shape)
    return View("board", pixels, np.ones(len(pixels)))


def test_points_on_a_plane_across_the_axis(calibration: Calibration) -> None:
    points = np.array([[0.1, -0.05, 0.8], [-0.2, 0.1, 0.8], [0.0, 0.0, 0.8]])
    measured = Measurer(calibration).on_planes(
        calibration.project(points), [BoardPose.facing(0.8)], [0, 0, 0]
    )
    assert np.abs(measured.points - points).max() < 1e-9
    assert measured.distance(0, 1)[0] == pytest.approx(
        np.linalg.norm(points[1] - points[0]), abs=1e-9
    )
    assert (measured.sigma[:, 2] == 0).all(), "the plane is given"
    assert measured.sigma[:, :2] == pytest.approx(0.1 / 2**0.5 * 0.8 / 2558, rel=0.2)


def test_points_on_two_boards(calibration: Calibration) -> None:
    spots = np.array([[0.03, 0.05, 0.0], [-0.07, 0.0, 0.0]])
    measurer = Measurer(calibration)
    boards = [measurer.board_pose(view_of(calibration, pose)) for pose in POSES]
    pixels = np.concatenate([seen(calibration, pose, spots) for pose in POSES])
    measured = measurer.on_planes(pixels, boards, [0, 0, 1, 1])
    true = np.concatenate([placed(spots, pose) for pose in POSES])
    assert np.abs(measured.points - true).max() < 1e-7
    assert measured.distance(0, 3)[0] == pytest.approx(np.linalg.norm(true[3] - true[0]), abs=1e-7)


def test_points_that_two_views_see(calibration: Calibration) -> None:
    """The board stands still and the camera moves; the points are off the board."""
    points = np.array([[0.02, 0.03, -0.05], [-0.06, 0.04, 0.10]])
    measurer = Measurer(calibration)
    boards = [measurer.board_pose(view_of(calibration, pose)) for pose in POSES]
    pixels = np.concatenate([seen(calibration, pose, points) for pose in POSES])
    measured = measurer.triangulate(pixels, boards, [0, 0, 1, 1], [0, 1, 0, 1])
    assert np.abs(measured.points - points).max() < 1e-7
    assert measured.gap_px.max() < 1e-3
    parallel = measurer.triangulate(pixels[[0, 0]], [boards[0], boards[0]], [0, 1], [0, 0])
    assert np.isnan(parallel.points).all(), "two pictures from one place say nothing of the depth"


@pytest.mark.parametrize("how", ["plane", "boards", pytest.param("views", marks=pytest.mark.slow)])
def test_sigma_equals_the_scatter_over_repeated_noise(how: str) -> None:
    """A camera without a cover, many times with other noise on corners and points: the spread is
    within its own statistical error.
    """
    calibration = lens_alone(scene(1, views=1), 820, 616, 640, 640, 410, 308)
    rng = np.random.default_rng(0)
    measurer = Measurer(calibration)
    on, error = np.array([[0.03, 0.05, 0.0], [-0.07, 0.01, 0.0]]), np.array([0, 0, -0.05])
    sideways = np.array([[0.1, 0.05, 0.7], [-0.1, 0.0, 0.7]])

    def boards(count: int) -> list[BoardPose]:
        return [measurer.board_pose(view_of(calibration, pose, rng)) for pose in POSES[:count]]

    def noisy(pixels: np.ndarray) -> np.ndarray:
        return np.asarray(pixels + rng.normal(0, NOISE / 2**0.5, pixels.shape))

    def once() -> tuple[MeasuredPoints, np.ndarray]:
        if how == "views":
            board_pixels = noisy(
                np.concatenate([seen(calibration, pose, on + error) for pose in POSES])
            )
            return measurer.triangulate(
                board_pixels, boards(2), [0, 0, 1, 1], [0, 1, 0, 1]
            ), on + error
        if how == "boards":
            return measurer.on_planes(
                noisy(seen(calibration, POSES[0], on)), boards(1), [0, 0]
            ), placed(on, POSES[0])
        return (
            measurer.on_planes(
                noisy(calibration.project(sideways)), [BoardPose.facing(0.7)], [0, 0]
            ),
            sideways,
        )

    errors, sigmas, separation, separation_sigmas = [], [], [], []
    for _ in range(REPEATS):
        measured, true = once()
        errors.append(measured.points - true)
        sigmas.append(measured.sigma)
        metres, sigma = measured.distance(0, 1)
        separation.append(metres - np.linalg.norm(true[1] - true[0]))
        separation_sigmas.append(sigma)
    counted = np.mean(sigmas, 0) > 0
    ratio = np.sqrt(np.mean(np.square(errors), 0))[counted] / np.mean(sigmas, 0)[counted]
    assert ratio.mean() == pytest.approx(1, abs=0.25)  # 16 % standard error each
    assert np.sqrt(np.mean(np.square(separation))) / np.mean(separation_sigmas) == pytest.approx(
        1, abs=0.4
    )


@pytest.mark.parametrize("how", ["boards", "views"])
def test_the_sigma_of_the_squares_enters_every_measurement(
    calibration: Calibration, how: str
) -> None:
    """Sigma is how much points and distances change with the side of the squares."""
    board = calibration.board
    points = np.array([[0.02, 0.03, 0.0], [-0.06, 0.04, 0.0]])
    pixels = np.concatenate([seen(calibration, pose, points) for pose in POSES])
    views = [view_of(calibration, pose) for pose in POSES]
    larger, doubted = (
        replace(board, square=1.001 * board.square),
        replace(board, square_sigma=0.001 * board.square),
    )
    results = []
    for item in (board, larger, doubted):
        measurer = Measurer(
            replace(
                calibration,
                board=replace(item, square_sigma=item.square_sigma or 0.0),
                noise_px=1e-6,
            )
        )
        poses = [measurer.board_pose(view) for view in views]
        if how == "views":
            results.append(measurer.triangulate(pixels, poses, [0, 0, 1, 1], [0, 1, 0, 1]))
        else:
            results.append(measurer.on_planes(pixels, poses, [0, 0, 1, 1]))
    unmoved, moved, uncertain = results
    change = np.abs(moved.points - unmoved.points)
    assert uncertain.sigma == pytest.approx(
        change, abs=0.02 * change.max()
    )  # rays that do not start at one point: 1 %
    assert uncertain.distance(0, 1)[1] == pytest.approx(0.001 * unmoved.distance(0, 1)[0], rel=0.02)


def test_a_view_that_is_turned_keeps_each_corner_s_weight(calibration: Calibration) -> None:
    view = view_of(calibration, POSES[0])
    corners, weight = view.corners.copy(), view.weight.copy()
    corners[3], weight[3] = np.nan, 0.0
    for turned in views_in_each_order(View("covered", corners, weight), calibration):
        assert np.array_equal(np.isnan(turned.corners[:, 0]), turned.weight == 0)


def test_uncertain_glass_shows_in_sigma(made: Scene) -> None:
    """If one amplitude alone is uncertain, the sigma of a distance between two boards is its change
    with that amplitude: the boards' poses are refitted, and a motion of all rays moves both boards
    alike.
    """
    truth = replace(known(made, WIDTH, HEIGHT), noise_px=1e-6)
    covariance = np.zeros((64, 64))
    covariance[27, 27] = 1e-6**2
    doubtful = replace(truth, covariance=covariance, views=made.views, poses=made.poses.numpy())
    amplitudes = truth.amplitudes.copy()
    amplitudes.flat[27] += 1e-6
    views = [view_of(truth, pose) for pose in POSES]
    pixels = np.concatenate([view.corners[::16] for view in views])
    results = []
    for calibration in (truth, replace(truth, amplitudes=amplitudes), doubtful):
        measurer = Measurer(calibration)
        results.append(
            measurer.on_planes(
                pixels, [measurer.board_pose(view) for view in views], [0] * 6 + [1] * 6
            )
        )
    pairs = [(i, j) for i in range(6) for j in range(6, 12)]
    distances = [[corners.distance(i, j) for i, j in pairs] for corners in results]
    unmoved, moved, uncertain = distances
    change = np.abs(np.array(moved) - np.array(unmoved))[:, 0]
    sigma = np.array(uncertain)[:, 1]
    assert change.max() > 1e-6
    assert sigma == pytest.approx(change, abs=0.03 * change.max())


def drawn_board(path: Path, calibration: Calibration, pose: np.ndarray) -> None:
    """A picture of the board: for each pixel of the camera, where its ray meets the board, and the
    colour of the square there.
    """
    camera, board = calibration.camera, calibration.board
    fine = (
        np.stack(
            np.meshgrid(np.arange(2 * camera.width), np.arange(2 * camera.height)), -1
        ).reshape(-1, 2)
        / 2
        - 0.25
    )
    measured = Measurer(calibration)
    origins, directions = measured.calibration.rays(fine)
    turn = cv2.Rodrigues(pose[:3])[0]
    depth = ((pose[3:] - origins) @ turn[:, 2]) / (directions @ turn[:, 2])
    on = ((origins + depth[:, None] * directions - pose[3:]) @ turn[:, :2]) / board.square + [
        (board.columns + 1) / 2,
        (board.rows + 1) / 2,
    ]
    black = (
        (np.floor(on).sum(1) % 2 == 0)
        & (on > 0).all(1)
        & (on < [board.columns + 1, board.rows + 1]).all(1)
    )
    sheet = np.where(black, 30, 200).astype(np.uint8).reshape(2 * camera.height, 2 * camera.width)
    cv2.imwrite(
        str(path),
        cv2.GaussianBlur(
            cv2.resize(sheet, (camera.width, camera.height), interpolation=cv2.INTER_AREA),
            (3, 3),
            0.6,
        ),
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A calibration, two pictures of one board, and points that were put there."""
    folder = tmp_path_factory.mktemp("measure")
    calibration = lens_alone(scene(1, views=1), 820, 616, 640, 640, 410, 308)
    calibration.save(folder / "calibration")
    points = np.array([[0.02, 0.03, 0.0], [-0.06, 0.04, 0.0], [0.01, -0.07, -0.06]])
    lines = ["# three points, the last above the board", "name,image,x,y"]
    for image, pose in zip(("a.png", "b.png"), POSES, strict=True):
        drawn_board(folder / image, calibration, pose)
        lines += [
            f"{name},{image},{x},{y}"
            for name, (x, y) in zip("pqr", seen(calibration, pose, points), strict=True)
        ]
    (folder / "points.csv").write_text("\n".join(lines) + "\n")
    (folder / "plane.csv").write_text("\n".join(lines[:4]) + "\n")
    rows = [
        ",".join([image, *map(str, pose)])
        for image, pose in zip(("a.png", "b.png"), POSES, strict=True)
    ]
    (folder / "poses.csv").write_text("image,rx,ry,rz,tx,ty,tz\n" + "\n".join(rows) + "\n")
    return folder


def said(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict[str, list[dict[str, Any]]]:
    assert main(["measure", *map(str, arguments), "--json"]) == 0
    answer: dict[str, list[dict[str, Any]]] = json.loads(capsys.readouterr().out)
    return answer


def test_the_command_measures_on_boards(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    answer = said(capsys, folder / "calibration", folder / "plane.csv", "--on-boards")
    assert answer["distances"][0]["m"] == pytest.approx(np.hypot(0.08, 0.01), abs=2e-4)
    exact = said(
        capsys,
        folder / "calibration",
        folder / "plane.csv",
        "--on-boards",
        "--poses",
        folder / "poses.csv",
    )
    assert exact["distances"][0]["m"] == pytest.approx(np.hypot(0.08, 0.01), abs=1e-7)
    assert exact["distances"][0]["sigma_m"] < answer["distances"][0]["sigma_m"]


def test_the_command_triangulates_although_a_board_looks_the_same_turned_about(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    answer = said(capsys, folder / "calibration", folder / "points.csv", "--triangulate")
    assert [point["name"] for point in answer["points"]] == ["p", "q", "r"]
    heights = [abs(point["m"][2]) for point in answer["points"]]
    assert heights == pytest.approx([0, 0, 0.06], abs=1e-3)
    assert answer["distances"][0]["m"] == pytest.approx(np.hypot(0.08, 0.01), abs=3e-4)
    assert max(point["gap_px"] for point in answer["points"]) < 1


def test_the_command_prints_a_table(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert (
        main(
            [
                "measure",
                str(folder / "calibration"),
                str(folder / "plane.csv"),
                "--depth",
                "0.6",
            ]
        )
        == 0
    )
    out = capsys.readouterr().out
    assert "camera frame, mm" in out
    rows = [
        re.fullmatch(
            r"([pqr]) +(-?[\d.]+ ± [\d.]+) +(-?[\d.]+ ± [\d.]+) +600 *( [\d.]+ ± [\d.]+)? *", line
        )
        for line in out.splitlines()
    ]
    assert [row[1] for row in rows if row] == [
        "p",
        "q",
    ], "each in one line of 80 columns, the depth as it was given"
    assert "Pixel noise 0.500 px per axis" in out, "that of a person's clicks"


def test_stated_noise_takes_the_place_of_a_click_s(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plane = (folder / "calibration", folder / "plane.csv", "--depth", "0.6")
    click: dict[str, Any] = said(capsys, *plane)
    stated: dict[str, Any] = said(capsys, *plane, "--noise", "0.05")
    assert click["noise_px"] == 0.5
    assert stated["noise_px"] == 0.05
    assert stated["points"][0]["sigma_m"][0] < click["points"][0]["sigma_m"][0] / 2


def test_pixels_outside_the_picture_are_refused_as_data(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The picture is 820x616; its border pixels reach half a pixel beyond their centres."""
    accepted = [(-0.5, -0.5), (819.5, 615.5), (410.0, 308.0)]
    refused = [(-0.51, 300.0), (819.51, 300.0), (400.0, -0.51), (400.0, 615.51), (5000.0, 300.0)]
    (folder / "border.csv").write_text(
        "\n".join(["x,y", *(f"{x},{y}" for x, y in accepted + refused)]) + "\n"
    )
    points = said(capsys, folder / "calibration", folder / "border.csv", "--depth", "0.6")["points"]
    assert [point["reason"] for point in points] == [None] * 3 + ["outside the picture"] * 5
    assert all(point["m"][2] == pytest.approx(0.6) for point in points[:3])
    for point in points[3:]:
        assert point["m"] == point["sigma_m"] == [None] * 3
        assert point["gap_px"] is None
    assert (
        main(["measure", str(folder / "calibration"), str(folder / "border.csv"), "--depth", "0.6"])
        == 0
    )
    out = capsys.readouterr().out
    assert "Not measured: 8: outside the picture." in out
    assert out.count("Not measured") == 5


def test_a_point_with_a_pixel_outside_is_not_triangulated(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "wide.csv").write_text(
        (folder / "points.csv").read_text() + "w,a.png,900,300\nw,b.png,400,300\n"
    )
    answer = said(capsys, folder / "calibration", folder / "wide.csv", "--triangulate")
    assert [point["reason"] for point in answer["points"]] == [
        None,
        None,
        None,
        "outside the picture",
    ]
    assert answer["distances"][1]["m"] > 0
    assert answer["distances"][2]["m"] is None


def test_every_point_that_is_not_measured_has_its_reason(calibration: Calibration) -> None:
    """A board that stands behind the camera; and rays that part."""
    measurer = Measurer(calibration)
    centre = np.array([[WIDTH / 2, HEIGHT / 2]])
    behind = measurer.on_planes(centre, [BoardPose.exactly(np.array([0, 0, 0, 0, 0, -1.0]))], [0])
    assert behind.reasons == (UnmeasuredReason.NO_POINT,)
    distant_poses = [BoardPose.exactly(np.array([0, 0, 0, shift, 0, 0.6])) for shift in (0.1, -0.1)]
    pixels = centre + np.array([[500.0, 0.0], [-500.0, 0.0]])
    parting = [
        measurer.triangulate(pixels[order], distant_poses, [0, 1], [0, 0])
        for order in ([0, 1], [1, 0])
    ]
    assert sorted(item.reasons[0] for item in parting) == [
        UnmeasuredReason.MEASURED,
        UnmeasuredReason.NOWHERE,
    ]
    for item in (behind, *parting):
        assert (
            np.isnan(item.points).any()
            == np.isnan(item.sigma).any()
            == np.isnan(item.gap_px).any()
            == bool(item.reasons[0])
        )


def test_pixels_that_no_ray_leaves_have_their_reason(calibration: Calibration) -> None:
    """Half a metre behind the camera, the cone is not in the picture."""
    cone = calibration.cover
    behind = replace(
        calibration,
        cover=replace(cone, parameters={**cone.parameters, "axis_offset.z": Number(-0.5)}),
    )
    measured = Measurer(behind).on_planes(
        np.array([[WIDTH / 2, HEIGHT / 2]]), [BoardPose.facing(1.0)], [0]
    )
    assert measured.reasons == (UnmeasuredReason.NO_RAY,)
    assert np.isnan(measured.points).all()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "has no column x"),
        ("x,y\n", "holds no entry"),
        ("x,y\n1,a\n", "entry 1: x, y are not all numbers"),
        ("x,y\n1,2\n3\n", "entry 2: x, y are not all numbers"),
        ("u,v\n1,2\n", "has no column x"),
        ("x;y\n1;2\n", "has semicolons between its columns: write commas"),
        ("x\ty\n1\t2\n", "has tabs between its columns: write commas"),
    ],
)
def test_points_files_get_their_sentence(tmp_path: Path, text: str, says: str) -> None:
    (tmp_path / "p.csv").write_text(text)
    with pytest.raises(InputError, match=says):
        read_points(tmp_path / "p.csv")


def test_the_columns_may_have_capitals(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text("X,Y,Image\n1,2,a.png\n")
    assert read_points(tmp_path / "p.csv") == [Point("1", "a.png", 1.0, 2.0)]


def test_files_that_cannot_be_read_get_their_sentence(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a text file"):
        read_poses(tmp_path / "p.csv")
    with pytest.raises(InputError, match="cannot be read"):
        read_poses(tmp_path / "none.csv")
    for name, kind in (("", "folder"), ("a.jpg", "picture")):
        with pytest.raises(InputError, match=f"is a {kind}: give a CSV .* with name,image,x,y"):
            read_points(tmp_path / name)


@pytest.mark.parametrize(
    ("points", "arguments", "says", "code"),
    [
        ("x,y\n1,2\n", ["--on-boards"], "add a column `image`", 2),
        ("name,image,x,y\np,a.png,1,2\n", ["--triangulate"], "p is in one picture only", 3),
        ("image,x,y\nnone.png,1,2\n", ["--on-boards"], "none.png cannot be read", 2),
        ("image,x,y\nblank.png,1,2\n", ["--on-boards"], "no 9x9 board found", 3),
        (
            "image,x,y\nsmall.png,1,2\n",
            ["--on-boards"],
            "is 50x40 px where the calibration is for 820x616",
            2,
        ),
        (
            "image,x,y\nc.png,1,2\n",
            ["--on-boards", "--poses", "poses.csv"],
            "the poses do not name c.png",
            2,
        ),
    ],
)
def test_input_that_cannot_be_measured_gets_a_sentence(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    points: str,
    arguments: list[str],
    says: str,
    code: int,
) -> None:
    (folder / "wrong.csv").write_text(points)
    cv2.imwrite(str(folder / "blank.png"), np.full((616, 820), 128, np.uint8))
    cv2.imwrite(str(folder / "small.png"), np.full((40, 50), 128, np.uint8))
    command_words = [str(folder / word) if word.endswith(".csv") else word for word in arguments]
    assert (
        main(["measure", str(folder / "calibration"), str(folder / "wrong.csv"), *command_words])
        == code
    )
    assert says in capsys.readouterr().err


def test_a_board_with_too_few_visible_corners_gives_no_pose(calibration: Calibration) -> None:
    view = view_of(calibration, POSES[0])
    small_view = View(
        "few.png",
        np.where(np.arange(81)[:, None] < 5, view.corners, np.nan),
        np.where(np.arange(81) < 5, 1.0, 0.0),
    )
    with pytest.raises(NotEnoughDataError, match=r"few.png: only 5 corners"):
        Measurer(calibration).board_pose(small_view)


@pytest.mark.parametrize(
    ("depth", "words"),
    [("0.0001", "0.0001 m is too near: write"), ("inf", "points at infinity have no place")],
)
def test_points_inside_the_cover_and_at_infinity_are_refused(
    folder: Path, depth: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "middle.csv").write_text("x,y\n400,300\n")
    words_typed = ["measure", str(folder / "calibration"), str(folder / "middle.csv")]
    assert main([*words_typed, "--depth", depth]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


def test_a_plane_inside_the_cover_is_too_near() -> None:
    measurer = Measurer(known(scene(1, views=1), WIDTH, HEIGHT))
    with pytest.raises(InputError, match=r"0\.01 m is too near: write"):
        measure_at_depth(measurer, [Point("a", "", 400.0, 300.0)], 0.01)
