"""Tags behind the cone: where Mitsuba's pictures show them, against where they were put and against
OpenCV's central camera.
"""

import csv
import io
import json
import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.apply.located_tags import LocatedTags, Tag, UnplacedReason
from calib.apply.tag_files import COLUMNS
from calib.apply.tags import TagLocator
from calib.calibration import Calibration
from calib.cli import main
from calib.corners.view import View
from calib.errors import InputError
from calib.fitting.fit import fit
from calib.fitting.inputs import read_views
from calib.io.images import read_grey
from calib.progress import Silent
from calib.session.session import read_session
from fixtures.rays import FIXTURES
from fixtures.tag_errors import Central, TagTruth, aligned, error_over_sigma

Array = NDArray[np.float64]

DICTIONARIES = {"april": "DICT_APRILTAG_36h11", "aruco": "DICT_4X4_50"}
PICTURES = FIXTURES / "bumps" / "tags"


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return fit(read_session(FIXTURES / "bumps"))


@pytest.fixture(scope="module")
def folder(calibration: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return calibration.save(tmp_path_factory.mktemp("tags") / "out").parent


@pytest.fixture(scope="module")
def truth() -> TagTruth:
    return TagTruth.of(PICTURES)


@pytest.fixture(scope="module")
def located(calibration: Calibration, truth: TagTruth) -> list[LocatedTags]:
    locators = {
        (family, side): TagLocator(calibration, name, side, side_sigma=0.0)
        for family, name in DICTIONARIES.items()
        for side in np.unique(truth.sides).tolist()
    }
    return [
        locators[name.split("-")[0], float(side)].locate(read_grey(PICTURES / name))
        for name, side in zip(truth.names, truth.sides, strict=True)
    ]


def held_out() -> tuple[View, ...]:
    return read_views(read_session(FIXTURES / "bumps" / "holdout"), Silent())[0]


def poses_of(located: list[LocatedTags]) -> list[tuple[int, Tag]]:
    """Every tag, with the number of its picture."""
    return [(picture, tag) for picture, item in enumerate(located) for tag in item.tags]


@pytest.mark.slow
def test_every_tag_is_placed_as_itself(located: list[LocatedTags], truth: TagTruth) -> None:
    for item, numbers in zip(located, truth.numbers, strict=True):
        assert [tag.number for tag in item.tags] == sorted(numbers.tolist())
        assert not item.unplaced
        assert not any(tag.ambiguous for tag in item.tags)


@pytest.mark.slow
def test_corners_are_where_light_put_them(located: list[LocatedTags], truth: TagTruth) -> None:
    error = np.array(
        [tag.corners - truth.corners[picture, tag.number] for picture, tag in poses_of(located)]
    )
    assert (
        np.sqrt((error**2).mean()) < 0.012
    )  # px per axis: the noise of the sensor and of JPEG, along edges of 43 to 320 px
    assert np.abs(error).max() < 0.06


@pytest.mark.slow
def test_turns_are_those_that_were_rendered(located: list[LocatedTags], truth: TagTruth) -> None:
    errors = [
        Rotation.from_matrix(tag.poses[0].turn @ truth.rotations[picture, tag.number].T)
        for picture, tag in poses_of(located)
    ]
    depth = truth.depths[[picture for picture, _ in poses_of(located)]]
    angle = np.rad2deg([item.magnitude() for item in errors])
    assert angle[depth < 0.4].max() < 0.06
    assert angle.max() < 0.45


@pytest.mark.slow
def test_tags_are_placed_five_times_more_exactly_than_by_a_central_camera(
    calibration: Calibration, located: list[LocatedTags], truth: TagTruth
) -> None:
    """OpenCV's best, fitted to the same session, with the same corners; each after the one rigid
    motion of all tags that fits best.
    """
    size = calibration.camera.width, calibration.camera.height
    assert calibration.camera.intrinsics
    central = Central.best(
        calibration.views, held_out(), calibration.board, size, calibration.camera.intrinsics
    )
    tags = poses_of(located)
    ours = np.array([tag.poses[0].position for _, tag in tags])
    theirs = np.array(
        [central.position(tag.corners, float(truth.sides[picture])) for picture, tag in tags]
    )
    true = np.array([truth.translations[picture, tag.number] for picture, tag in tags])
    at = np.array([(truth.sides[picture], truth.depths[picture]) for picture, _ in tags])
    our_errors = np.linalg.norm(aligned(ours, true), axis=-1)
    central_errors = np.linalg.norm(aligned(theirs, true), axis=-1)
    for side, depth in np.unique(at, axis=0).tolist():
        selected = (at == (side, depth)).all(-1)
        mine = np.sqrt((our_errors[selected] ** 2).mean())
        central_error = np.sqrt((central_errors[selected] ** 2).mean())
        assert mine < central_error / 5, (
            f"{side} m at {depth} m: {1e3 * mine:.3f} and {1e3 * central_error:.3f} mm"
        )


@pytest.mark.slow
def test_the_errors_of_tags_scatter_by_their_sigma(
    located: list[LocatedTags], truth: TagTruth
) -> None:
    tags = poses_of(located)
    true = np.array([truth.translations[picture, tag.number] for picture, tag in tags])
    poses = [tag.poses[0] for _, tag in tags]
    assert 0.4 < error_over_sigma(poses, true, together=False) < 1.6
    assert (
        0.4 < error_over_sigma(poses, true, together=True) < 3
    )  # the least of what they share is predicted too well


def test_errors_that_tags_share_cancel_in_distances(calibration: Calibration) -> None:
    """On Kalibr's board, through the glass of `bumps`: 24 mm, border of two cells, tags 31.2 mm
    apart.
    """
    picture = FIXTURES / "aprilgrid" / "frames" / "0000.jpg"
    result = TagLocator(calibration, "DICT_APRILTAG_36h11", 0.024, side_sigma=0.0, border=2).locate(
        read_grey(picture)
    )
    assert len(result.tags) > 30
    place = {tag.number: tag for tag in result.tags}
    pairs = [
        (place[item], place[item + 1]) for item in place if item % 6 != 5 and item + 1 in place
    ]
    between = np.array([first.poses[0].distance(second.poses[0]) for first, second in pairs])
    assert np.abs(between[:, 0] - 0.0312).max() < 0.001
    assert 0.3 < np.mean(((between[:, 0] - 0.0312) / between[:, 1]) ** 2) < 3
    ahead = np.mean(
        [second.poses[0].position - first.poses[0].position for first, second in pairs], 0
    )
    assert place[0].poses[0].turn[:, 0] @ ahead > 0.03, (
        "x of an upright tag is to the right, as Kalibr numbers them"
    )


def test_the_sigma_of_the_side_enters_the_pose(calibration: Calibration, truth: TagTruth) -> None:
    grey = read_grey(PICTURES / truth.names[0])
    exact = TagLocator(calibration, "DICT_APRILTAG_36h11", 0.05, 0.0).locate(grey).tags[0].poses[0]
    by_kind = (
        TagLocator(calibration, "DICT_APRILTAG_36h11", 0.05, None).locate(grey).tags[0].poses[0]
    )
    stated = (
        TagLocator(calibration, "DICT_APRILTAG_36h11", 0.05, 0.0005).locate(grey).tags[0].poses[0]
    )
    assert np.allclose(exact.position, stated.position, atol=1e-9)
    distance = np.linalg.norm(exact.position)
    for pose, relative_sigma in ((by_kind, 0.002), (stated, 0.01)):
        length = pose.position / distance
        grown = length @ (pose.covariance - exact.covariance)[3:, 3:] @ length
        assert np.sqrt(grown) == pytest.approx(relative_sigma * distance, rel=0.02)


def test_a_number_that_is_seen_twice_is_not_placed(
    calibration: Calibration, truth: TagTruth
) -> None:
    at = truth.names.index("aruco-050-1500.jpg")
    grey = read_grey(PICTURES / truth.names[at]).copy()
    (x, y), reach = truth.corners[at, 0].mean(0).astype(int), 40
    grey[600 - reach : 600 + reach, 600 - reach : 600 + reach] = grey[
        y - reach : y + reach, x - reach : x + reach
    ]
    results = TagLocator(calibration, "DICT_4X4_50", 0.05).locate(grey)
    assert [(item.number, item.reason) for item in results.unplaced] == [(0, UnplacedReason.TWICE)]
    assert 0 not in [tag.number for tag in results.tags]


def test_a_tag_that_is_no_flat_square_is_not_placed(
    calibration: Calibration, truth: TagTruth
) -> None:
    """One corner is pulled: its edges stay straight, but no square looks like that."""
    at = truth.names.index("aruco-050-0300.jpg")
    grey = read_grey(PICTURES / truth.names[at])
    outline = truth.corners[at, 0]
    middle = outline.mean(0)
    apart_px = outline - middle
    pulled = middle + apart_px * np.array([[1.0], [1.0], [1.2], [1.0]])
    around = middle + 1.4 * apart_px
    matrix = cv2.getPerspectiveTransform(outline.astype(np.float32), pulled.astype(np.float32))
    warped = cv2.warpPerspective(grey, matrix, grey.shape[::-1], borderMode=cv2.BORDER_REPLICATE)
    mask = cv2.fillConvexPoly(np.zeros_like(grey), np.rint(around).astype(np.int32), 1)
    results = TagLocator(calibration, "DICT_4X4_50", 0.05).locate(np.where(mask == 1, warped, grey))
    assert [(item.number, item.reason) for item in results.unplaced] == [
        (0, UnplacedReason.NO_SQUARE)
    ]


def test_pictures_of_16_bits_give_the_same_result(
    calibration: Calibration, truth: TagTruth
) -> None:
    grey = read_grey(PICTURES / truth.names[-1])
    locator = TagLocator(
        calibration, DICTIONARIES[truth.names[-1].split("-")[0]], float(truth.sides[-1])
    )
    eight_bit = locator.locate(grey).tags
    many = locator.locate(grey.astype(np.uint16) * 257).tags
    assert [tag.number for tag in eight_bit] == [tag.number for tag in many]
    assert np.allclose(
        [t.poses[0].position for t in eight_bit], [t.poses[0].position for t in many], atol=2e-5
    )


def srgb(grey: NDArray) -> NDArray[np.uint8]:
    """Levels as most cameras store light."""
    light = grey / 255
    curved: Array = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.rint(255 * curved).astype(np.uint8)


@pytest.mark.parametrize("name", ["april-050-0500.jpg", "aruco-050-1500.jpg"])
def test_a_curve_of_tones_moves_no_tag(
    calibration: Calibration, truth: TagTruth, name: str
) -> None:
    """A fit that knows nothing of it has black 0.5 px too narrow."""
    at, grey = truth.names.index(name), read_grey(PICTURES / name)
    locator = TagLocator(calibration, DICTIONARIES[name.split("-")[0]], 0.05, side_sigma=0.0)
    straight, curved = locator.locate(grey), locator.locate(srgb(grey))
    assert straight.growth.px == 0
    assert curved.growth.px == pytest.approx(-0.238, abs=0.01)
    assert [tag.number for tag in curved.tags] == truth.numbers[at].tolist()
    for tag in curved.tags:
        pose = tag.poses[0]
        assert (
            abs(
                np.linalg.norm(pose.position) / np.linalg.norm(truth.translations[at, tag.number])
                - 1
            )
            < 1e-3
        )
        assert np.abs(tag.corners - truth.corners[at, tag.number]).max() < 0.06


def test_a_calibration_without_covariance_counts_the_corners_noise_alone(
    calibration: Calibration, truth: TagTruth
) -> None:
    alone = replace(calibration, covariance=np.zeros((0, 0)))
    grey = read_grey(PICTURES / truth.names[0])
    bare = TagLocator(alone, "DICT_APRILTAG_36h11", 0.05, 0.0).locate(grey).tags[0].poses[0]
    full = TagLocator(calibration, "DICT_APRILTAG_36h11", 0.05, 0.0).locate(grey).tags[0].poses[0]
    assert bare.shared.shape == (6, 1)
    assert (bare.sigma <= full.sigma * 1.0001).all()
    assert np.allclose(bare.position, full.position, atol=1e-4)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("DICT_4x4_50", 0.05), "'DICT_4x4_50' is no dictionary of tags: write DICT_4X4_50."),
        (("DICT_4X4_50", float("nan")), "a tag of nan mm will not do"),
        (("DICT_4X4_50", -0.05), "a tag of -50 mm will not do"),
        (("DICT_4X4_50", 0.05, 0.06), "a standard deviation of 60 mm will not do"),
        (("DICT_4X4_50", 0.05, float("nan")), "a standard deviation of nan mm will not do"),
    ],
)
def test_a_locator_refuses_wrong_arguments(
    calibration: Calibration, arguments: tuple, message: str
) -> None:
    with pytest.raises(InputError, match=re.escape(message)):
        TagLocator(calibration, *arguments)


def run(*arguments: object) -> int:
    return main(["pose", *map(str, arguments)])


def test_a_side_that_may_be_in_metres_is_doubted(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((64, 64), 200, np.uint8))
    options = ("--tags", "DICT_4X4_50", "--size-mm")
    doubt = "--size-mm 0.05 is in millimetres, and hardly any printer draws that. If metres were"
    run(folder, tmp_path / "empty.png", *options, "0.05")
    assert f"Take care: {doubt} meant, write 50.\n" in capsys.readouterr().err
    run(folder, tmp_path / "empty.png", *options, "50")
    assert "millimetres" not in capsys.readouterr().err
    arguments = ["board", "--square-mm", "0.1", "-o", str(tmp_path / "board")]
    assert main(arguments) == 0
    assert "Take care: --square-mm 0.1 is in millimetres" in capsys.readouterr().err


@pytest.mark.slow
def test_the_command_prints_what_the_library_finds(
    folder: Path,
    located: list[LocatedTags],
    truth: TagTruth,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    picture, table = PICTURES / truth.names[0], tmp_path / "poses.csv"
    tags = ("--tags", "DICT_APRILTAG_36h11", "--size-mm", "50", "--size-sigma-mm", "0")
    assert run(folder, picture, *tags, "-o", table, "--json") == 0
    answer = json.loads(capsys.readouterr().out)
    assert (answer["frame"], answer["dictionary"], answer["size_mm"], answer["written"]) == (
        "camera",
        "DICT_APRILTAG_36h11",
        50.0,
        [str(table)],
    )
    (item,) = answer["pictures"]
    assert (item["picture"], item["not_placed"]) == (str(picture), [])
    rows = list(csv.DictReader(io.StringIO(table.read_text())))
    assert tuple(rows[0]) == COLUMNS
    assert len(rows) == len(item["tags"]) == len(located[0].tags)
    for tag, row, reference in zip(item["tags"], rows, located[0].tags, strict=True):
        (pose,), expected = tag["poses"], reference.poses[0]
        assert (tag["id"], tag["ambiguous"], pose["probability"]) == (reference.number, False, 1.0)
        assert np.allclose(tag["corners_px"], reference.corners)
        assert np.allclose(pose["m"], expected.position)
        assert np.allclose(Rotation.from_rotvec(pose["rotation_rad"]).as_matrix(), expected.turn)
        assert np.allclose(Rotation.from_quat(pose["quaternion_xyzw"]).as_matrix(), expected.turn)
        assert np.allclose(pose["covariance"], expected.covariance)
        assert np.allclose([*pose["sigma_turn_rad"], *pose["sigma_m"]], expected.sigma)
        assert int(row["tag"]) == reference.number
        assert np.allclose([float(row[key]) for key in ("x_m", "y_m", "z_m")], expected.position)
        assert float(row["cov_turn_z_x"]) == pytest.approx(expected.covariance[2, 3], rel=1e-6)
        assert float(row["cov_z_z"]) == pytest.approx(float(row["sigma_z_m"]) ** 2, rel=1e-6)
    assert run(folder, picture, *tags) == 0
    out = capsys.readouterr().out
    assert "turn, degrees" in out
    distances = {tag.number: 1000 * tag.poses[0].position[2] for tag in located[0].tags}
    printed = next(line for line in out.splitlines() if line.startswith("5 "))
    assert float(printed.split()[3]) == pytest.approx(distances[5], abs=0.005)


def test_pictures_without_tags_are_listed_as_well(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((1232, 1640), 99, np.uint8))
    assert (
        run(
            folder,
            tmp_path / "empty.png",
            PICTURES / "aruco-050-0300.jpg",
            "--tags",
            "DICT_4X4_50",
            "--size-mm",
            "50",
        )
        == 0
    )
    assert f"{tmp_path / 'empty.png'}: no tag is seen." in capsys.readouterr().out


def test_the_other_pictures_are_read_beside_a_damaged_one(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    picture = (PICTURES / "aruco-050-0300.jpg").read_bytes()
    (pictures / "0.jpg").write_bytes(picture[:5000])
    (pictures / "1.jpg").write_bytes(picture)
    cv2.imwrite(str(pictures / "2.png"), np.full((48, 64), 99, np.uint8))
    assert run(folder, pictures, "--tags", "DICT_4X4_50", "--size-mm", "50", "--json") == 0
    captured = capsys.readouterr()
    answer = json.loads(captured.out)
    assert [Path(item["picture"]).name for item in answer["pictures"]] == ["1.jpg"]
    assert [Path(item["picture"]).name for item in answer["left_out"]] == ["0.jpg", "2.png"]
    assert f"left out: {pictures / '0.jpg'} is truncated" in captured.err
    assert f"left out: {pictures / '2.png'}: the picture is 64x48 px" in captured.err


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        ("PICTURE --tags DICT_4X4_50", 2, "--size-mm"),
        ("PICTURE --tags DICT_4X4_50 --size-mm nan", 2, "'nan' is not a side of a square"),
        ("PICTURE --tags DICT_4X4_50 --size-mm -5", 2, "'-5' is not a side of a square"),
        (
            "PICTURE --tags DICT_4X4_50 --size-mm 50 --size-sigma-mm nan",
            2,
            "'nan' is not a number of 0 or more: write one",
        ),
        (
            "PICTURE --tags DICT_4X4_50 --size-mm 50 --size-sigma-mm 60",
            2,
            "a standard deviation of 60 mm will not do",
        ),
        (
            "PICTURE --tags TAG36 --size-mm 50",
            2,
            "'TAG36' is no dictionary of tags: write DICT_APRILTAG_36h11",
        ),
        (
            "SMALL --tags DICT_4X4_50 --size-mm 50",
            2,
            "the picture is 64x48 px where the calibration is for 1640x1232",
        ),
        (
            "EMPTY --tags DICT_4X4_50 --size-mm 50",
            3,
            "no tag of DICT_4X4_50 is seen in empty.png: check the dictionary",
        ),
        (
            "KALIBR --tags DICT_APRILTAG_36h11 --size-mm 24",
            3,
            "have a border of 2, not 1: write --border 2.",
        ),
        ("nowhere.png --tags DICT_4X4_50 --size-mm 50", 2, "nowhere.png cannot be read"),
        ("FOLDER --tags DICT_4X4_50 --size-mm 50", 2, "holds no picture"),
        ("PICTURE --tags DICT_4X4_50 --size-mm 50 -o FOLDER", 2, "is a folder, and"),
        (
            "EMPTY --tags DICT_4X4_50 --size-mm 50 -o INSIDE",
            2,
            "cannot be made",
        ),  # told before tags are sought
    ],
)
def test_bad_input_is_one_sentence(
    arguments: str,
    code: int,
    message: str,
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    cv2.imwrite(str(tmp_path / "small.png"), np.full((48, 64), 99, np.uint8))
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((1232, 1640), 99, np.uint8))
    (tmp_path / "folder").mkdir()
    places = {
        "PICTURE": PICTURES / "aruco-050-1500.jpg",
        "SMALL": tmp_path / "small.png",
        "EMPTY": tmp_path / "empty.png",
        "KALIBR": FIXTURES / "aprilgrid" / "frames" / "0000.jpg",
        "FOLDER": tmp_path / "folder",
        "INSIDE": tmp_path / "empty.png" / "poses.csv",
    }
    words = [str(places.get(word, word)) for word in arguments.split()]
    try:
        outcome = run(folder, *words)
    except SystemExit as end:  # argparse's own
        outcome = int(str(end.code))
    captured = capsys.readouterr()
    assert outcome == code
    assert message in " ".join(captured.err.split())
    assert "Traceback" not in captured.err
    assert captured.out == ""
