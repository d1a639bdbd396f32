"""A recording of ROS becomes a session: its sharpest pictures, with the times of their headers."""

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

pytest.importorskip("rosbags", reason="the extra `bags` is not installed")

from calib.cli import main
from calib.importing.from_video import MAX_FRAMES
from calib.io.frames_table import read_frame_records
from calib.io.images import list_images, read_image
from calib.session.session import read_session
from tests.io.bags import INTERVAL_NS, KINDS, START_NS, TOPIC, RawPicture, jpeg, raw, write_bag
from tests.io.odd_bags import write_odd_bag

BOARD = ("--board", "9x6", "--square-mm", "25")
RNG = np.random.default_rng(2)


def noise(count: int) -> list[np.ndarray]:
    return [RNG.integers(0, 256, (24, 32, 3), dtype=np.uint8) for _ in range(count)]


def imported(
    folder: Path,
    kind: str,
    pictures: Sequence[RawPicture | Mapping[str, object]],
    *,
    info: bool = True,
) -> Path:
    bag = write_bag(folder / "source", kind, pictures, info=info)
    session = folder / "session"
    assert main(["import", "bag", str(bag), *BOARD, "-o", str(session)]) == 0
    return session


@pytest.mark.parametrize("kind", KINDS)
def test_the_pictures_and_their_times_come_over(tmp_path: Path, kind: str) -> None:
    pictures = noise(3)
    session = imported(tmp_path, kind, [raw("bgr8", picture) for picture in pictures])
    paths = list_images(session / "frames")
    assert len(paths) == 3
    for path, picture in zip(paths, pictures, strict=True):
        np.testing.assert_array_equal(read_image(path), picture)
    records = read_frame_records(session / "frames.csv")
    times = [records[path.name].time_s for path in paths]
    expected = [1e-9 * (START_NS + number * INTERVAL_NS) for number in range(3)]
    assert times == pytest.approx(expected, abs=1e-6), "s: of the headers, not of the recorder"
    camera = read_session(session).camera
    assert (camera.width, camera.height) == (32, 24)


def test_sixteen_bits_and_jpegs_come_over(tmp_path: Path) -> None:
    deep = RNG.integers(0, 65536, (24, 32), dtype=np.uint16)
    (path,) = list_images(imported(tmp_path / "a", "mcap", [raw("mono16", deep)]) / "frames")
    np.testing.assert_array_equal(read_image(path), deep)
    smooth = cv2.GaussianBlur(noise(1)[0], (0, 0), 5)
    (path,) = list_images(imported(tmp_path / "b", "bag", [jpeg(smooth)]) / "frames")
    np.testing.assert_allclose(read_image(path).astype(int), smooth.astype(int), atol=12)


def test_of_a_long_recording_the_sharpest_pictures_are_kept(tmp_path: Path) -> None:
    """Every second picture is blurred."""
    pictures = noise(2 * MAX_FRAMES)
    for number in range(0, len(pictures), 2):
        pictures[number] = cv2.GaussianBlur(pictures[number], (0, 0), 3)
    session = imported(tmp_path, "mcap", [raw("bgr8", picture) for picture in pictures])
    numbers = [int(path.stem) for path in list_images(session / "frames")]
    assert len(numbers) == MAX_FRAMES
    assert all(number % 2 for number in numbers)
    with (session / "frames.csv").open() as table:
        assert [int(Path(row["file"]).stem) for row in csv.DictReader(table)] == numbers


def test_the_camera_info_is_a_remark_that_can_be_pasted(tmp_path: Path) -> None:
    text = (imported(tmp_path, "mcap", [raw("bgr8", noise(1)[0])]) / "session.yaml").read_text()
    line = next(line for line in text.splitlines() if "intrinsics: {" in line)
    intrinsics = yaml.safe_load(line.lstrip("# "))["intrinsics"]
    assert intrinsics == {"fx": 500, "fy": 510, "cx": 70, "cy": 50} | {
        "distortion": [0.1, -0.2, 0, 0, 0]
    }
    bare = imported(tmp_path / "bare", "mcap", [raw("bgr8", noise(1)[0])], info=False)
    assert "intrinsics: {" not in (bare / "session.yaml").read_text()


def test_a_wrong_topic_is_refused_and_no_folder_is_made(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = write_bag(tmp_path / "source", "mcap", [raw("bgr8", noise(1)[0])])
    session = tmp_path / "session"
    command = ["import", "bag", str(bag), *BOARD, "--topic", "/no", "-o", str(session)]
    assert main(command) == 2
    assert "has no pictures on /no: choose one with --topic, of /camera/image_raw." in (
        capsys.readouterr().err
    )
    assert not session.exists()


SHORT = RawPicture("mono8", 32, 24, 32, bytes(9))
SMALL = raw("bgr8", np.zeros((12, 16, 3), np.uint8))


def test_pictures_that_cannot_be_used_are_left_out_and_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first, last = noise(2)
    session = imported(tmp_path, "mcap", [SHORT, raw("bgr8", first), SMALL, raw("bgr8", last)])
    error = capsys.readouterr().err
    assert "2 pictures are left out, the first for this: " in error
    assert "/camera/image_raw: a picture of 32x24 px has only 9 bytes" in error
    paths = list_images(session / "frames")
    assert [path.name for path in paths] == ["1.png", "3.png"], "numbered as in the recording"
    np.testing.assert_array_equal(read_image(paths[1]), last)
    session = imported(tmp_path / "size", "bag", [raw("bgr8", first), SMALL])
    error = capsys.readouterr().err
    assert "1 picture is left out: " in error
    assert "a picture has 16x12 px and the first one 32x24 px" in error


def test_a_cut_message_and_other_types_on_the_topic_are_no_pictures(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (picture,) = noise(1)
    bag = write_odd_bag(tmp_path / "bag", picture, level_topic=TOPIC, cut=True, definitions=True)
    session = tmp_path / "session"
    assert main(["import", "bag", str(bag), *BOARD, "-o", str(session)]) == 0
    assert "1 picture is left out: " in capsys.readouterr().err
    assert len(list_images(session / "frames")) == 2


@pytest.mark.parametrize("count", [1, 40])
def test_a_recording_without_a_picture_that_can_be_used_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], count: int
) -> None:
    bag = write_bag(tmp_path / "source", "mcap", count * [SHORT])
    session = tmp_path / "session"
    assert main(["import", "bag", str(bag), *BOARD, "-o", str(session)]) == 2
    error = capsys.readouterr().err
    assert "/camera/image_raw: a picture of 32x24 px has only 9 bytes" in error
    assert [path.name for path in tmp_path.iterdir()] == ["source"]
