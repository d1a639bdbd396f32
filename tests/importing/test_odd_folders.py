"""Folders as people have them: stray sizes, foreign types, pairs of cameras, phones' EXIF."""

import gzip
import json
from pathlib import Path
from shutil import copyfile

import cv2
import numpy as np
import pytest
from PIL import Image

from calib.cli import main
from calib.io.camera_names import find_cameras
from calib.session.session import read_session
from tests.importing import recordings
from tests.importing.recordings import SIZE, TARGET

BOARD = ["--board", "7x6", "--square-mm", "25"]
FRAMES = Path(__file__).parents[2] / "fixtures" / "clean" / "frames"


def imported(
    folder: Path, capsys: pytest.CaptureFixture[str], *options: str
) -> tuple[list[str], str]:
    """The names of the session's pictures, and the notices."""
    session = folder.with_name("session")
    assert main(["import", "images", str(folder), *BOARD, *options, "-o", str(session)]) == 0
    read = read_session(session)
    assert (read.camera.width, read.camera.height) == SIZE
    return [path.name for path in read.frames], capsys.readouterr().err


@pytest.mark.parametrize("size", [(1280, 960), (641, 481), (480, 640), (64, 48)])
def test_the_size_of_most_pictures_is_taken_and_strays_are_named(
    size: tuple[int, int], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = recordings.write_pictures(tmp_path / "p")
    for name in ("a first.png", "shot 99.png"):
        cv2.imwrite(str(folder / name), np.zeros(size[::-1], np.uint8))
    names, notices = imported(folder, capsys)
    assert len(names) == 8
    stated = f"{size[0]}x{size[1]}"
    assert (
        f"another size than 640x480 px: a first.png ({stated}), shot 99.png ({stated})." in notices
    )
    assert notices.count("\n") == 1


@pytest.mark.parametrize("suffix", [".pgm", ".ppm", ".webp", ".PGM"])
def test_other_types_are_read(
    suffix: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = recordings.write_pictures(tmp_path / "p")
    for path in sorted(folder.iterdir())[:5]:
        flag = cv2.IMREAD_GRAYSCALE if suffix.lower() == ".pgm" else cv2.IMREAD_COLOR
        pixels = cv2.imread(str(path), flag)
        assert pixels is not None
        cv2.imwrite(str(path.with_suffix(suffix)), pixels)
        path.unlink()
    names, notices = imported(folder, capsys)
    assert (len(names), notices) == (8, "")


@pytest.mark.parametrize("name", ["IMG_0001.HEIC", "raw.dng", "clip.mov", "a.gif"])
def test_what_is_not_read_is_named(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = recordings.write_pictures(tmp_path / "p")
    (folder / name).write_bytes(b"\0" * 100)
    (folder / "notes.txt").write_text("mine")
    names, notices = imported(folder, capsys)
    assert len(names) == 8
    assert f"not read as pictures: {name}. Save them as png, jpg" in notices
    assert "notes" not in notices


HEIC = b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + bytes(100)


@pytest.mark.parametrize(
    ("name", "content", "reason"),
    [
        ("IMG_1.JPG", HEIC, "is HEIC inside, whatever its name says"),
        ("IMG_1.png", b"", "is an empty file"),
        ("shot 5.png", None, "is truncated or damaged"),
        ("a.tif", b"II*\0" + bytes(9), "is not an image, or a damaged one"),
        ("a.npy", b"\x93NUMPY", "is not a whole .npy array"),
    ],
    ids=["heic", "empty", "truncated", "tiff", "npy"],
)
@pytest.mark.usefixtures("without_figures")
def test_a_damaged_picture_is_left_out_by_name(
    name: str,
    content: bytes | None,
    reason: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = recordings.write_pictures(tmp_path / "p")
    path = folder / name
    path.write_bytes(path.read_bytes()[:-2000] if content is None else content)
    names, notices = imported(folder, capsys)
    assert name not in names
    assert len(names) == (7 if content is None else 8)
    assert f"left out, damaged pictures: {name} ({reason})." in notices
    assert main(["fit", str(folder), *BOARD, "--json", "-q"]) == 0
    rejected = json.loads(capsys.readouterr().out)["frames_rejected"]
    assert rejected == [{"file": name, "reason": reason}]
    out = str(tmp_path / "straight")
    words = ["undistort", str(folder / "calibration"), str(folder), "--depth", "0.5", "-o", out]
    assert main(words) == 0
    captured = capsys.readouterr()
    assert len(captured.out.splitlines()) == len(names)
    assert f"left out: {path} {reason}:" in captured.err
    words[2] = str(path)
    assert main(words) == 2, "it was named by itself"


@pytest.mark.usefixtures("without_figures")
def test_a_link_to_nothing_is_left_out_by_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = recordings.write_pictures(tmp_path / "p")
    (folder / "gone.png").symlink_to(tmp_path / "unplugged" / "gone.png")
    names, notices = imported(folder, capsys)
    assert len(names) == 8
    assert "left out, damaged pictures: gone.png (cannot be read)." in notices
    assert main(["fit", str(folder), *BOARD, "--json", "-q"]) == 0
    rejected = json.loads(capsys.readouterr().out)["frames_rejected"]
    assert rejected == [{"file": "gone.png", "reason": "cannot be read"}]


@pytest.mark.parametrize("name", ["shot 0.png", "shot 4.png", "shot 7.png"])
def test_a_board_is_looked_for_in_the_whole_pictures(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = recordings.write_pictures(tmp_path / "p")
    (folder / name).write_bytes(HEIC)
    assert main(["fit", str(folder)]) == 2
    assert "Found a checkerboard of 7x6 inner corners" in capsys.readouterr().err
    for path in folder.iterdir():
        path.write_bytes(HEIC)
    assert main(["fit", str(folder)]) == 2
    assert "shot 0.png is HEIC inside" in capsys.readouterr().err


def test_one_camera_of_a_pair_is_chosen(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = recordings.write_pair(tmp_path / "p")
    names, _ = imported(folder, capsys, "--camera", "right")
    assert names == [f"right-{i:02d}.png" for i in range(8)]


def test_all_pictures_of_a_pair_may_be_one_camera_s(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    names, _ = imported(recordings.write_pair(tmp_path / "p"), capsys, "--camera", "all")
    assert len(names) == 16


@pytest.mark.parametrize(
    ("names", "cameras"),
    [
        (["left01.jpg", "left02.jpg", "right01.jpg", "right02.jpg"], ("left", "right")),
        (["cam0_a.png", "cam0_b.png", "cam1_a.png", "cam1_b.png"], ("cam0", "cam1")),
        (["01_L.png", "02_L.png", "01_R.png", "02_R.png"], ("l", "r")),
        ([f"img_{side}_{i}.png" for side in ("left", "right") for i in (7, 8)], ("left", "right")),
        (["L0001.bmp", "R0001.bmp", "L0002.bmp", "R0002.bmp"], ("l", "r")),
        (["left01.jpg", "left02.jpg", "left03.jpg"], ()),
        (["left-near.png", "right-far.png", "middle.png"], ()),
        (["left-1.png", "left-2.png", "right-3.png", "right-4.png"], ()),
        (["camera_1.jpg", "camera_2.jpg", "camera_3.jpg"], ()),
        (["bright1.png", "bright2.png", "cleft1.png"], ()),
    ],
)
def test_cameras_by_names(names: list[str], cameras: tuple[str, ...]) -> None:
    assert find_cameras(names) == cameras


def with_exif(path: Path, model: str, focal_mm: float, serial: str) -> None:
    image = Image.open(path)
    exif = image.getexif()
    exif[271], exif[272] = "Maker", model
    exif.get_ifd(0x8769)[0x920A] = focal_mm
    exif.get_ifd(0x8769)[0xA431] = serial
    image.save(path.with_suffix(".jpg"), exif=exif, quality=95)
    path.unlink()


@pytest.mark.parametrize(
    ("other", "says"),
    [
        (
            ("Model B", 4.2, "17"),
            ["the camera that", "Maker Model A in 6", "Maker Model B in shot 0"],
        ),
        (("Model A", 6.8, "17"), ["the focal length that", "4.2 mm in 6", "6.8 mm in shot 0.jpg"]),
        (("Model A", 4.2, "18"), ["the serial number that", "17 in 6 of them"]),
        (("Model A", 4.2, "17"), []),
    ],
)
def test_pictures_of_two_cameras_or_zooms_are_said(
    other: tuple[str, float, str],
    says: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    folder = recordings.write_pictures(tmp_path / "p")
    for i, path in enumerate(sorted(folder.iterdir())):
        with_exif(path, *(other if i < 2 else ("Model A", 4.2, "17")))
    _, notices = imported(folder, capsys)
    assert notices.count("\n") == bool(says)
    for words in says:
        assert words in notices


def test_a_damaged_exif_is_as_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = recordings.write_pictures(tmp_path / "p")
    path = folder / "shot 1.png"
    with_exif(path, "Model A", 4.2, "17")
    content = bytearray(path.with_suffix(".jpg").read_bytes())
    at = content.index(b"Exif") + 10
    content[at : at + 4] = b"\xff" * 4
    path.with_suffix(".jpg").write_bytes(content)
    assert imported(folder, capsys)[1] == ""


@pytest.mark.parametrize("head", ["%YAML:1.0\n---\n", "%YAML:1.0\n", "%YAML 1.0\n---\n"])
def test_the_head_that_opencv_writes_is_passed_over(head: str, tmp_path: Path) -> None:
    folder = recordings.kalibr(tmp_path / "k", target=head + TARGET)
    assert main(["import", "kalibr", str(folder), "-o", str(tmp_path / "s")]) == 0
    assert read_session(tmp_path / "s").board == recordings.BOARD


@pytest.mark.parametrize("kind", ["mark", "gzip", "gzip of a mark"])
def test_corners_with_a_byte_order_mark_or_packed(kind: str, tmp_path: Path) -> None:
    lines = ["# filename x y level"]
    for i, corners in enumerate(recordings.corners()):
        lines += [f"{i}.png {x} {y} 0" for x, y in corners.reshape(-1, 2)]
    text = "\n".join(lines).encode()
    marked = text if kind == "gzip" else b"\xef\xbb\xbf" + text
    path = tmp_path / "c.vnl"
    path.write_bytes(marked if kind == "mark" else gzip.compress(marked))
    arguments = [str(path), *BOARD, "--size", "640x480", "-o", str(tmp_path / "s")]
    assert main(["import", "mrcal-corners", *arguments]) == 0
    if "gzip" in kind:
        path.write_bytes(path.read_bytes()[:-20])
        assert main(["import", "mrcal-corners", *arguments[:-1], str(tmp_path / "t")]) == 2


@pytest.mark.slow
@pytest.mark.usefixtures("without_figures")
def test_a_part_of_a_larger_board_is_no_board(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The detector finds 7x5 corners somewhere on the board of 9x9, elsewhere in each picture."""
    folder = tmp_path / "p"
    folder.mkdir()
    for picture in sorted(FRAMES.iterdir())[:10]:
        copyfile(picture, folder / picture.name)
    words = ["fit", str(folder), "--board", "7x5", "--square-mm", "20", "--cover", "none"]
    assert main(words) == 3
    message = capsys.readouterr().err
    assert "show a board of 9x9 inner corners, and the declared 7x5 is a part of it" in message
    assert "calib fit with --board 9x9" in message
