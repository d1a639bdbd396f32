"""`calib board` as a person runs it, and the session that grows from it."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from calib.calibration import Calibration
from calib.cli import main
from calib.corners.detection import Detection
from calib.corners.find import find_board
from calib.io.yaml_reader import read_yaml
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.coding import AprilGrid, Charuco
from calib.session.session import session_from_mapping
from calib.session.shapes.registry import SHAPES
from tests.sheet.reading import exposed, made, pdf_polygons, rasterise, svg_polygons

FOCAL = 900.0  # px, of the camera that sees the print
SIZE = 800, 600
BLUR = 0.5  # px, of its lens


def run(folder: Path, *options: str) -> int:
    return main(["board", "-o", str(folder), *options])


def read_setup(file: Path) -> tuple[Board, Camera, object]:
    written = dict(read_yaml(file))
    assert written.pop("format") == 1
    return session_from_mapping(written, str(file))


@pytest.fixture
def printed(tmp_path: Path) -> Path:
    """The folder of a 9x6 board for A4."""
    assert (
        run(
            tmp_path / "session",
            "--type",
            "checkerboard",
            "--columns",
            "9",
            "--rows",
            "6",
            "--paper",
            "A4",
            "--size",
            "800x600",
        )
        == 0
    )
    return tmp_path / "session"


def test_three_files_of_one_board(
    printed: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path) == 0
    assert capsys.readouterr().out.split() == [
        str(tmp_path / name) for name in ("board.pdf", "board.svg", "session.yaml")
    ]
    polygons = svg_polygons((printed / "board.svg").read_text(encoding="utf-8"))
    assert np.array_equal(polygons, pdf_polygons((printed / "board.pdf").read_bytes()))
    assert np.array_equal(polygons, np.round(made("A4").polygons, 4))
    board, camera, _ = read_setup(printed / "session.yaml")
    assert (board, board.square_sigma) == (Board(9, 6, 0.02), None)
    assert (camera.width, camera.height) == SIZE


@pytest.mark.parametrize("shape", [shape.name for shape in SHAPES if shape.has_glass])
def test_every_cover_that_it_offers_can_be_used(shape: str, printed: Path) -> None:
    file = printed / "session.yaml"
    beginning = f"# cover: {{shape: {shape},"
    lines = [line for line in file.read_text().splitlines() if line.startswith(beginning)]
    (line,) = lines
    mapping = {
        key: value for key, value in read_yaml(file).items() if key != "format"
    } | yaml.safe_load(line.removeprefix("# "))
    session_from_mapping(mapping, "session.yaml")


def test_the_measured_lengths_go_where_the_sheet_says(printed: Path) -> None:
    """A print 1 % too large, read with a ruler in mm: its square is known to 0.5 mm of the shorter
    ruler.
    """
    file = printed / "session.yaml"
    text = file.read_text()
    assert "VALUE = 20 * (a / 250 + b / 150) / 2 and SIGMA = 20 * D / 2 / 150" in text
    a, b, d = 252.5, 151.5, 1.0
    value, sigma = 20 * (a / 250 + b / 150) / 2, 20 * d / 2 / 150
    file.write_text(
        text.replace("square_mm: 20.0", f"square_mm: {{value: {value}, sigma: {sigma}}}")
    )
    board, _, _ = read_setup(file)
    assert board.square == pytest.approx(0.0202)
    assert board.relative_sigma == pytest.approx(0.5 / 151.5)


def test_pictures_of_the_print_become_a_calibration(
    printed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A pinhole's pictures of the rasterised page give its focal length and, in mm, where the board
    was: to a thousandth, where 0.03 px on a board of 300 px are a tenth of that.
    """
    raster = rasterise((printed / "board.pdf").read_bytes(), dpi=200)
    middle = np.mean(made("A4").corners, axis=0)
    metres = np.diag([*raster.mm / 1000, 1.0])  # from px of the page to the board's own
    metres[:2, 2] = (raster.mm / 2 - middle) / 1000
    camera = np.array([[FOCAL, 0, (SIZE[0] - 1) / 2], [0, FOCAL, (SIZE[1] - 1) / 2], [0, 0, 1]])
    finer = np.array(
        [[6.0, 0, 2.5], [0, 6, 2.5], [0, 0, 1]]
    )  # than the page's pixels; pixel centres stay centres
    rng = np.random.default_rng(3)
    (printed / "frames").mkdir()
    shifts = rng.uniform([-0.03, -0.03, 0.42], [0.03, 0.03, 0.6], (8, 3))
    for number, shift in enumerate(shifts):
        onto = (
            finer
            @ camera
            @ np.column_stack([cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))[0][:, :2], shift])
            @ metres
        )
        large = cv2.warpPerspective(
            raster.grey, onto, (6 * SIZE[0], 6 * SIZE[1]), flags=cv2.INTER_LINEAR, borderValue=90
        )
        taken = cv2.resize(
            cv2.GaussianBlur(large, (0, 0), 6 * BLUR), SIZE, interpolation=cv2.INTER_AREA
        )
        cv2.imwrite(str(printed / "frames" / f"{number}.png"), exposed(np.asarray(taken, np.uint8)))
    capsys.readouterr()
    assert main(["fit", str(printed), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames_used"] == 8
    calibration = Calibration.load(printed / "calibration")
    intrinsics = calibration.camera.intrinsics
    assert intrinsics
    assert (intrinsics.fx.value, intrinsics.fy.value) == pytest.approx((FOCAL, FOCAL), rel=1e-3)
    assert np.linalg.norm(calibration.poses[:, 3:], axis=1) == pytest.approx(
        np.linalg.norm(shifts, axis=1), rel=1e-3
    )


def test_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(tmp_path, "--json", "--paper", "letter", "--square-mm", "15.5") == 0
    answer = json.loads(capsys.readouterr().out)
    assert list(answer) == ["type", "board", "paper_mm", "rulers_mm", "corners_mm", "written"]
    assert answer["type"] == "checkerboard"
    assert answer["board"] == {"columns": 9, "rows": 6, "square_mm": 15.5}
    assert sorted(answer["paper_mm"]) == [215.9, 279.4]
    assert np.array(answer["corners_mm"]).shape == (54, 2)
    assert answer["written"] == [
        str(tmp_path / name) for name in ("board.pdf", "board.svg", "session.yaml")
    ]


def test_the_same_board_is_the_same_file(printed: Path, tmp_path: Path) -> None:
    assert run(tmp_path / "again", "--size", "800x600") == 0
    for name in ("board.pdf", "board.svg", "session.yaml"):
        assert (printed / name).read_bytes() == (tmp_path / "again" / name).read_bytes()


def test_no_session_is_overwritten(printed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy = shutil.copytree(printed, printed.with_name("before"))
    capsys.readouterr()
    assert run(printed, "--rows", "7") == 2
    file = printed / "session.yaml"
    assert (
        capsys.readouterr().err
        == f"calib: error: {file} is there already, and no session is overwritten: give another"
        " folder with -o, or replace its session.yaml with --overwrite.\n"
    )
    assert all((copy / path.name).read_bytes() == path.read_bytes() for path in printed.iterdir())
    assert run(printed, "--rows", "7", "--overwrite") == 0
    assert (copy / "session.yaml").read_bytes() != file.read_bytes()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            ["--paper", "A9"],
            (
                "'A9' is not a paper: write A4, A3, Letter, or width x height from 50 to 5000 mm,"
                " such as 600x400"
            ),
        ),
        (["--paper", "20x30"], "'20x30' is not a paper"),
        (["--paper", "nanx100"], "'nanx100' is not a paper"),
        (
            ["--columns", "1"],
            (
                "'1' is not a number of corners or tags: write a whole number from 2 to 1000, such"
                " as 9"
            ),
        ),
        (
            ["--type", "charuco", "--marker", "1"],
            "'1' is not a marker's part of a square: write a number from 0.3 to 0.9",
        ),
        (
            ["--type", "aprilgrid", "--spacing", "wide"],
            "'wide' is not a part of a tag: write a number from 0.05 to 1",
        ),
        (["--square-mm", "-1"], "'-1' is not a side of a square"),
        (["--size", "0x600"], "'0x600' is not a size"),
        (["--type", "circles"], "invalid choice 'circles'"),
    ],
)
def test_wrong_usage(
    options: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        run(tmp_path / "s", *options)
    assert ended.value.code == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "s").exists()


def test_a_board_that_does_not_fit_leaves_no_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path / "s", "--square-mm", "40") == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith(
        "calib: error: 9x6 corners with squares of 40 mm have no room on A4"
    )
    assert captured.err.count("\n") == 1
    assert not (tmp_path / "s").exists()


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--square-mm", "25"], "The white margin is 6.1 mm, narrower than a square"),
        (["--columns", "7", "--rows", "7"], "A board of 7x7 corners looks the same upside down"),
    ],
)
def test_remarks_go_to_stderr(
    options: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path / "s", *options) == 0
    assert capsys.readouterr().err.startswith(f"Note: {says}")
    assert run(tmp_path / "none") == 0
    assert capsys.readouterr().err == ""


CODED = [
    (["--type", "charuco"], Board(9, 6, 0.02, coding=Charuco(0.015, "DICT_4X4_250"))),
    (
        [
            "--type",
            "charuco",
            "--columns",
            "6",
            "--marker",
            "0.7",
            "--dictionary",
            "DICT_5X5_100",
            "--square-mm",
            "18",
        ],
        None,
    ),
    (
        [
            "--type",
            "charuco",
            "--columns",
            "6",
            "--rows",
            "7",
            "--legacy-pattern",
            "--square-mm",
            "18",
        ],
        Board(6, 7, 0.018, coding=Charuco(0.0135, "DICT_4X4_250", legacy_pattern=True)),
    ),
    (["--type", "aprilgrid"], None),
    (
        [
            "--type",
            "aprilgrid",
            "--columns",
            "5",
            "--rows",
            "4",
            "--spacing",
            "0.25",
            "--tag-mm",
            "24",
        ],
        Board(10, 8, 0.024, coding=AprilGrid(0.25)),
    ),
]


@pytest.mark.parametrize(("options", "expected"), CODED)
def test_the_session_s_board_is_found_where_the_sheet_says(
    options: list[str], expected: Board | None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the command line to every corner of the printed page, by the board as session.yaml says
    it: to 0.05 mm, half a pixel. The page is blurred by 0.7 px, as no camera's picture is as sharp.
    """
    assert run(tmp_path / "s", *options, "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    board, _, _ = read_setup(tmp_path / "s" / "session.yaml")
    assert expected in (None, board)
    raster = rasterise((tmp_path / "s" / "board.pdf").read_bytes())
    detection = find_board(np.asarray(cv2.GaussianBlur(raster.grey, (0, 0), 0.7), np.uint8), board)
    assert isinstance(detection, Detection)
    error = np.linalg.norm(raster.place(detection.corners) - answer["corners_mm"], axis=1)
    assert error.max() < 0.05, f"{error.max():.4f} mm"
    middle = np.mean(answer["corners_mm"], axis=0)
    assert np.abs(board.points() * 1000 + middle - answer["corners_mm"]).max() < 1e-3


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (
            ["--columns", "2"],
            "a board of --type checkerboard has 3 corners or more in each direction",
        ),
        (
            ["--type", "aprilgrid", "--square-mm", "20"],
            "--square-mm does not apply to a board of --type aprilgrid: leave it out",
        ),
        (["--tag-mm", "20"], "--tag-mm does not apply to a board of --type checkerboard"),
        (
            ["--type", "charuco", "--columns", "12", "--rows", "12", "--dictionary", "DICT_4X4_50"],
            "needs 84 markers where DICT_4X4_50 has 50",
        ),
    ],
)
def test_options_of_another_board(
    options: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(tmp_path / "s", *options) == 2
    assert says in capsys.readouterr().err
    assert not (tmp_path / "s").exists()
