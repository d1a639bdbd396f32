"""Other things in the place of a file, and files with false sizes, are refused before they cost
anything.
"""

import json
import os
import socket
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from calib.apply.measure_files import read_points
from calib.corners.corners_file import read_corners
from calib.corners.detect_all import DETECTIONS_FILE, detect
from calib.errors import InputError
from calib.importing.from_ros import from_ros_archive
from calib.io.arrays import decode_npy, decode_npz
from calib.io.depth_image import read_depth_image
from calib.io.files import npz, read_file
from calib.io.frames_table import last_view, read_frame_records
from calib.io.images import list_images, read_image
from calib.io.yaml_reader import MAX_LEVELS, read_yaml
from calib.session.board import Board
from calib.session.session import read_session
from tests.fuzz.cases import tars
from tests.session.malformed import SESSION, write_good_session

BOARD = Board(6, 5, 0.02)
READERS: tuple[Callable[[Path], object], ...] = (
    read_yaml,
    read_image,
    read_depth_image,
    read_frame_records,
    read_points,
    lambda path: read_corners(path, BOARD),
    lambda path: from_ros_archive(path, BOARD, None),
)


def put(path: Path, data: bytes | str) -> Path:
    path.write_bytes(data.encode() if isinstance(data, str) else data)
    return path


@pytest.mark.parametrize("read", READERS)
def test_a_pipe_and_a_device_are_not_waited_for(
    read: Callable[[Path], object], tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / "zero").symlink_to("/dev/zero")
    for name in ("fifo", "zero"):
        with pytest.raises(InputError, match="is not a file but a pipe or a device"):
            read(tmp_path / name)


def test_a_socket_is_no_file(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as held:
        held.bind(str(tmp_path / "s"))
        with pytest.raises(InputError, match="s cannot be read"):
            read_file(tmp_path / "s")


def test_a_file_that_is_too_large_gets_the_limit_in_its_sentence(tmp_path: Path) -> None:
    path = tmp_path / "a"
    with path.open("wb") as file:
        file.truncate((1 << 20) + 1)  # sparse: it takes no room
    assert len(read_file(path, (1 << 20) + 1)) == (1 << 20) + 1
    with pytest.raises(InputError, match="a is larger than the 1 MB that such a file may have"):
        read_file(path, 1 << 20)


def test_kept_detections_that_are_a_pipe_do_not_hold_up_a_fit(tmp_path: Path) -> None:
    frames = write_good_session(tmp_path / "s") / "frames"
    os.mkfifo(frames / DETECTIONS_FILE)
    assert len(detect(list_images(frames), BOARD).views) == 3


@pytest.mark.parametrize(
    "wrong", ["12", True, None, [1.0, "2"], [True, False], [[1], [2]], {"a": 1}]
)
def test_kept_detections_of_another_kind_are_looked_for_again(
    wrong: object, tmp_path: Path
) -> None:
    frames = write_good_session(tmp_path / "s") / "frames"
    good = detect(list_images(frames), BOARD).views
    answer = json.loads((frames / DETECTIONS_FILE).read_text())
    answer["files"]["0000.png"]["corners"][3] = wrong
    answer["files"]["0001.jpg"]["corners"] = wrong
    answer["files"]["0002.png"]["size"] = wrong
    (frames / DETECTIONS_FILE).write_text(json.dumps(answer))
    for view, earlier_view in zip(detect(list_images(frames), BOARD).views, good, strict=True):
        if wrong is not None or view.name == "0002.png":  # null says: not measured, or not found
            np.testing.assert_array_equal(view.corners, earlier_view.corners)


@pytest.mark.parametrize(
    "time_s",
    ["1e10", "-1e10", "1e300", "1760000000123", "1760000000123456789", "9" * 5000, "nan", "soon"],
)
def test_a_time_that_no_clock_shows_is_refused(time_s: str, tmp_path: Path) -> None:
    table = put(
        tmp_path / "frames.csv", f"file,time_s,sequence,view\na.png,{time_s},0,{'7' * 5000}\n"
    )
    with pytest.raises(
        InputError,
        match=r"time_s of a\.png is '.{1,90}': write seconds, such as 12\.5, less than 1e\+10",
    ) as caught:
        read_frame_records(table)
    assert len(str(caught.value)) <= 400


def test_a_view_of_5000_digits_is_a_label_and_no_number() -> None:
    assert last_view([{"file": "a", "view": "9" * 5000}, {"file": "b", "view": "3"}]) == 3


def test_a_level_of_1000_is_refused(tmp_path: Path) -> None:
    path = put(tmp_path / "corners.vnl", "# filename x y level\na 1 2 1000\n")
    with pytest.raises(InputError, match="line 2: level is 1000: write 0 for the best corners"):
        read_corners(path, BOARD)


@pytest.mark.parametrize("sigma", ["1e300", "1e-300", "1.0e+101"])
def test_a_sigma_that_cannot_be_squared_is_refused(sigma: str, tmp_path: Path) -> None:
    folder = write_good_session(tmp_path / "s")
    put(
        folder / "session.yaml",
        SESSION.replace("thickness_mm: 3.0", f"thickness_mm: {{value: 3.0, sigma: {sigma}}}"),
    )
    with pytest.raises(
        InputError, match=r"cover\.thickness_mm\.sigma is .*: write a number above 0, up to 1e\+100"
    ):
        read_session(folder)


@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000, 1000000), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-1, 5), }",
        "{'descr': '|u1', 'fortran_order': False, 'shape': (99999999999999999999,), }",
        "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
        "{'descr': '<f8'}",
        "[" * 5000,
        "",
    ],
)
def test_a_header_that_declares_too_much_data_is_refused(header: str) -> None:
    data = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode() + bytes(64)
    with pytest.raises(ValueError, match=r"\w"):
        decode_npy(data)


def test_a_zip_is_no_npy_and_a_bomb_no_npz(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    packed = bytes(npz({"a": np.zeros((100, 100))}))
    path = put(tmp_path / "a.npy", packed)
    for read in (read_image, read_depth_image):
        with pytest.raises(InputError, match=r"not a (whole \.npy array|depth image)"):
            read(path)
    assert decode_npz(packed)["a"].shape == (100, 100)
    monkeypatch.setattr("calib.io.arrays.MAX_DECODED_BYTES", 80_000)
    with pytest.raises(ValueError, match="when unpacked"):
        decode_npz(packed)


def test_an_archive_with_a_declared_tebibyte_is_refused(tmp_path: Path) -> None:
    archive, claimed = tars(b"picture")
    assert [
        data
        for _, data in from_ros_archive(put(tmp_path / "whole.tar", archive), BOARD, None).frames
    ] == [b"picture"]
    with pytest.raises(
        InputError, match=r"left-0000\.png in it is larger than the 256 MB that a picture may have"
    ):
        from_ros_archive(put(tmp_path / "claimed.tar", claimed), BOARD, None)


def test_a_jpeg_that_ends_in_erased_flash_is_refused_at_once(tmp_path: Path) -> None:
    path = put(tmp_path / "a.jpg", b"\xff\xd8\xff\xe0\x00\x04ab" + b"\xff" * 3_000_000)
    start_time = time.process_time()
    with pytest.raises(InputError, match="truncated or damaged"):
        read_image(path)
    assert time.process_time() - start_time < 5, (
        "of this process alone; it was 21 s for a fiftieth of it, and grew with the square"
    )


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a: " + "[" * 20_000, f"more than {MAX_LEVELS} levels"),
        ("- " * 20_000, f"more than {MAX_LEVELS} levels"),
        ("a: " + "{b: " * 100 + "1" + "}" * 100, f"more than {MAX_LEVELS} levels"),
        ("a: &a [*a]", f"more than {MAX_LEVELS} levels"),
        (
            "a0: &a0 [x, x]\n"
            + "".join(f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]\n" for i in range(1, 25)),
            "aliases that repeat it too often",
        ),
        ("a: " + "x" * 3_000_000, "larger than the 2 MB"),
    ],
)
def test_yaml_that_would_take_minutes_or_gigabytes_is_refused(
    text: str, says: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=says):
        read_yaml(put(tmp_path / "a.yaml", text))


def test_a_cell_beyond_the_limit_of_csv_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="is not a CSV table"):
        read_points(put(tmp_path / "points.csv", f"x,y\n1,{'2' * 200_000}\n"))
