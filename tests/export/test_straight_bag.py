"""A straightened recording: its pictures are the undistorter's, its camera_info and transform
describe the pinhole that took them, and everything else is the same.
"""

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags", reason="the extra `bags` is not installed")

from calib.apply.colour import ColourUndistorter
from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.cli import main
from calib.export.straight_bag import straight_camera
from calib.io.bag_picture import message_image
from calib.session.dispersion import Dispersion
from fixtures.known import known, lens_alone
from fixtures.synthetic import scene
from tests.io.bags import FRAME, INFO, NOTE, START_NS, TOPIC, jpeg, raw, read_bag, write_bag
from tests.io.odd_bags import LEVELS, write_odd_bag

WIDTH, HEIGHT = 328, 246
DEPTH = 0.5
SPOTS = np.random.default_rng(0).integers(0, 256, (3, 12, 16, 3), dtype=np.uint8)
PICTURES = [np.asarray(cv2.resize(spots, (WIDTH, HEIGHT)), np.uint8) for spots in SPOTS]


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return known(scene(3, views=1, grid=(4, 4), amplitude=1e-5), WIDTH, HEIGHT)


@pytest.fixture(scope="module")
def saved(calibration: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return Path(calibration.save(tmp_path_factory.mktemp("calibration")))


def straightened(saved: Path, bag: Path, output: Path, *options: str) -> dict[str, Any]:
    """Return the messages of each topic of what `calib undistort` makes of a recording."""
    command = ["undistort", str(saved), str(bag), "--depth", str(DEPTH), "-o", str(output)]
    assert main([*command, *options]) == 0
    assert [path.name for path in output.parent.iterdir() if path.suffix == output.suffix] == [
        output.name
    ], "nothing else is left there"
    return read_bag(output)


@pytest.mark.parametrize("kind", ["bag", "mcap", "folder"])
def test_pictures_are_straight_and_all_else_is_the_same(
    calibration: Calibration, saved: Path, tmp_path: Path, kind: str
) -> None:
    source = write_bag(tmp_path / "source", kind, [raw("bgr8", p) for p in PICTURES])
    output = tmp_path / "out" / ("straight.bag" if kind == "bag" else "straight.mcap")
    topics = straightened(saved, source, output)
    original = read_bag(source)
    assert topics.keys() == {TOPIC, INFO, NOTE, "/tf_static"}
    assert [entry[:2] for entry in topics[NOTE]] == [entry[:2] for entry in original[NOTE]]

    undistorter = Undistorter(calibration, DEPTH)
    assert len(topics[TOPIC]) == len(PICTURES)
    for picture, (time_ns, _, message), before in zip(
        PICTURES, topics[TOPIC], original[TOPIC], strict=True
    ):
        np.testing.assert_array_equal(message_image(message), undistorter.undistort(picture))
        assert time_ns == before[0]
        assert message.header.stamp == before[2].header.stamp
        assert message.header.frame_id == f"{FRAME}_straight"

    camera = straight_camera(undistorter)
    assert len(topics[INFO]) == len(PICTURES)
    for (_, _, info), before in zip(topics[INFO], original[INFO], strict=True):
        assert (info.width, info.height) == (WIDTH, HEIGHT)
        assert info.header.stamp == before[2].header.stamp
        assert info.header.frame_id == f"{FRAME}_straight"
        k, d, p = (info.K, info.D, info.P) if kind == "bag" else (info.k, info.d, info.p)
        np.testing.assert_array_equal(k.reshape(3, 3), camera.matrix)
        np.testing.assert_array_equal(p.reshape(3, 4)[:, :3], camera.matrix)
        assert not d.any()
    ((_, _, static),) = topics["/tf_static"]
    (transform,) = static.transforms
    assert transform.header.frame_id == FRAME
    assert transform.child_frame_id == f"{FRAME}_straight"
    moved = transform.transform.translation
    np.testing.assert_array_equal([moved.x, moved.y, moved.z], camera.centre)
    assert transform.transform.rotation.w == 1


def test_colour_fringes_are_removed_from_a_bag(tmp_path: Path, calibration: Calibration) -> None:
    dispersion = {"refractive_index": Dispersion(abbe=40)}
    coloured = replace(calibration, cover=replace(calibration.cover, dispersion=dispersion))
    saved = Path(coloured.save(tmp_path / "calibration"))
    source = write_bag(tmp_path / "source", "mcap", [raw("rgb8", PICTURES[0][..., ::-1])])
    topics = straightened(saved, source, tmp_path / "out" / "straight.mcap", "--colour")
    ((_, _, message),) = topics[TOPIC]
    straight = message_image(message)
    np.testing.assert_array_equal(
        straight, ColourUndistorter(coloured, DEPTH).undistort(PICTURES[0])
    )
    assert (straight != Undistorter(coloured, DEPTH).undistort(PICTURES[0])).any()


def test_the_straight_camera_is_exact_at_its_depth_and_better_than_the_origin_elsewhere(
    calibration: Calibration,
) -> None:
    """Its pictures of points on the rays, by OpenCV, against the pixels that show them."""
    undistorter = Undistorter(calibration, DEPTH, crop=0.0, size=(400, 300))
    camera = straight_camera(undistorter)
    assert np.linalg.norm(camera.centre) > 1e-4, "m: a cover moves the centre"
    columns, rows = np.meshgrid(np.linspace(60, 260, 9), np.linspace(50, 190, 7))
    pixels = np.column_stack([columns.ravel(), rows.ravel()])
    origins, directions = undistorter.rays(pixels)
    shown = undistorter.undistort_points(pixels)

    def errors(depth: float, matrix: np.ndarray, centre: np.ndarray) -> float:
        """Return the root mean square in px at points of this depth, m."""
        points = origins + directions * ((depth - origins[:, 2]) / directions[:, 2])[:, None]
        projected = cv2.projectPoints(points - centre, np.zeros(3), np.zeros(3), matrix, None)[0]
        return float(np.sqrt(((projected.reshape(-1, 2) - shown) ** 2).sum(1).mean()))

    assert errors(DEPTH, camera.matrix, camera.centre) < 1e-3, "px"
    for depth in (0.25, 1.0, 4.0):
        ours = errors(depth, camera.matrix, camera.centre)
        origin = errors(depth, undistorter.camera_matrix, np.zeros(3))
        assert ours < 0.7 * origin, f"{ours:.3f} px against {origin:.3f} px at {depth} m"


def test_a_camera_without_a_cover_keeps_its_centre() -> None:
    made = scene(3, views=1)
    undistorter = Undistorter(lens_alone(made, WIDTH, HEIGHT, 250, 250, 160, 120, -0.2), DEPTH)
    camera = straight_camera(undistorter)
    assert not camera.centre.any()
    np.testing.assert_array_equal(camera.matrix, undistorter.camera_matrix)


def test_compressed_pictures_without_camera_info_get_one(saved: Path, tmp_path: Path) -> None:
    topic = "/camera/image_raw/compressed"
    pictures = [jpeg(picture) for picture in PICTURES]
    source = write_bag(tmp_path / "source", "mcap", pictures, topic=topic, info=False)
    topics = straightened(saved, source, tmp_path / "o" / "s.mcap", "--crop", "0", "--topic", topic)
    assert [message.format for _, _, message in topics[topic]] == 3 * ["jpeg"]
    stamps = [message.header.stamp for _, _, message in topics[topic]]
    assert [message.header.stamp for _, _, message in topics[INFO]] == stamps


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_a_static_transform_that_is_there_is_kept(saved: Path, tmp_path: Path, kind: str) -> None:
    pictures = [raw("mono8", picture[..., 0]) for picture in PICTURES]
    source = write_bag(tmp_path / "source", kind, pictures, transforms=True)
    output = tmp_path / "o" / ("s.bag" if kind == "bag" else "s.mcap")
    static = straightened(saved, source, output)["/tf_static"]
    assert [len(message.transforms) for _, _, message in static] == [0, 1]
    assert static[0][0] == START_NS - 1


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("source", "-o", "s.bag", "--depth", "1"), "a recording of ROS 2 becomes a .mcap"),
        (("source", "-o", "source", "--depth", "1"), "source is a folder"),
        (("source", "-o", "s.mcap", "--depth", "1", "--topic", "/x"), "no pictures on /x"),
        (("source", "source", "-o", "s.mcap", "--depth", "1"), "give it alone"),
        (
            ("source", "-o", "s.mcap", "--depth-image", "d.npy"),
            "metres, or --depth-topic",
        ),
        (("source", "-o", "s.mcap", "--depth-topic", "/x"), "has no depth images on /x"),
        (("source", "-o", "s.mcap", "--depth-topic", TOPIC), "no topic of pictures beside the"),
        (
            ("source", "-o", "s.mcap", "--depth-topic", TOPIC, "--topic", TOPIC),
            "--topic and --depth-topic both name /camera/image_raw",
        ),
        (("p.png", "-o", "s", "--depth-topic", "/x"), "--depth-topic is for a bag"),
        (("source", "-o", "s.mcap"), "or --depth-topic"),
        (("small", "-o", "s.mcap", "--depth", "1"), "is 32x24 px where the calibration is for"),
        (("p.png", "-o", "s", "--depth", "1", "--topic", "/x"), "--topic is for a bag"),
    ],
)
def test_wrong_usage_is_one_sentence_and_leaves_no_file(
    saved: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_bag(tmp_path / "source", "folder", [raw("bgr8", PICTURES[0])])
    write_bag(tmp_path / "small", "folder", [raw("mono8", np.zeros((24, 32), np.uint8))])
    before = sorted(tmp_path.rglob("*"))
    assert main(["undistort", str(saved), *options]) == 2
    error = capsys.readouterr().err
    assert sentence in error.split("calib: error: ")[-1]
    assert error.count("calib: error: ") == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_a_damaged_picture_is_left_out_and_the_others_are_straight(
    calibration: Calibration,
    saved: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    kind: str,
) -> None:
    good = [raw("bgr8", picture) for picture in PICTURES]
    pictures = [replace(good[0], data=bytes(9)), good[1], raw("bgr8", PICTURES[2][:50]), good[2]]
    source = write_bag(tmp_path / "source", kind, pictures)
    output = tmp_path / "out" / ("s.bag" if kind == "bag" else "s.mcap")
    topics = straightened(saved, source, output)
    error = capsys.readouterr().err
    assert "2 pictures are left out, the first for this: " in error
    assert f"{TOPIC}: a picture of 328x246 px has only 9 bytes" in error
    undistorter = Undistorter(calibration, DEPTH)
    assert [time_ns for time_ns, _, _ in topics[TOPIC]] == [
        read_bag(source)[TOPIC][number][0] for number in (1, 3)
    ]
    for picture, (_, _, message) in zip(PICTURES[1:], topics[TOPIC], strict=True):
        np.testing.assert_array_equal(message_image(message), undistorter.undistort(picture))
    assert len(topics[NOTE]) == 4
    assert len(topics["/tf_static"]) == 1


@pytest.mark.parametrize("definitions", [True, False])
def test_messages_of_an_unknown_type_are_copied(
    saved: Path, tmp_path: Path, definitions: bool
) -> None:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    source = write_odd_bag(tmp_path / "source", PICTURES[0], definitions=definitions)
    output = tmp_path / "s.mcap"
    command = ["undistort", str(saved), str(source), "--depth", "0.5", "-o", str(output)]
    assert main(command) == 0
    copies = []
    for path in (source, output):
        with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
            entries = [entry for entry in reader.messages() if entry[0].topic == LEVELS]
        copies.append([(c.msgtype, time_ns, bytes(data)) for c, time_ns, data in entries])
    assert len(copies[0]) == 3
    assert copies[1] == copies[0]


def test_other_messages_on_the_topic_of_the_pictures_are_copied(
    calibration: Calibration, saved: Path, tmp_path: Path
) -> None:
    source = write_odd_bag(tmp_path / "source", PICTURES[0], level_topic=TOPIC)
    messages = straightened(saved, source, tmp_path / "o" / "s.mcap")[TOPIC]
    levels = [message.level for _, _, message in messages if hasattr(message, "level")]
    assert levels == [0, 1, 2]
    straight = [message_image(m) for _, _, m in messages if hasattr(m, "encoding")]
    expected = Undistorter(calibration, DEPTH).undistort(PICTURES[0])
    np.testing.assert_array_equal(straight, np.stack(3 * [expected]))


def test_a_message_that_is_cut_is_left_out(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = write_odd_bag(tmp_path / "source", PICTURES[0], cut=True)
    assert len(straightened(saved, source, tmp_path / "o" / "s.mcap")[TOPIC]) == 2
    error = capsys.readouterr().err
    assert f"1 picture is left out: {source}, {TOPIC}: a message is damaged (" in error


def test_a_foreign_file_is_not_replaced(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = write_bag(tmp_path / "source", "mcap", [raw("bgr8", PICTURES[0])])
    output = tmp_path / "out.mcap"
    output.write_bytes(b"mine")
    command = ["undistort", str(saved), str(source), "--depth", "1", "-o", str(output)]
    assert main(command) == 2
    assert output.read_bytes() == b"mine"
    assert "is not calib's own" in capsys.readouterr().err
    assert main([*command, "--overwrite"]) == 0
    assert main(command) == 0, "what calib wrote, it may replace"


def test_without_the_package_the_command_says_what_to_install(
    saved: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    source = write_bag(tmp_path / "source", "mcap", [raw("bgr8", PICTURES[0])])
    monkeypatch.setitem(sys.modules, "rosbags.highlevel", None)
    command = ["undistort", str(saved), str(source), "--depth", "1", "-o", str(tmp_path / "s.mcap")]
    assert main(command) == 2
    assert "Bags need one more package: " in capsys.readouterr().err
