"""Straightened files: pictures are in test_cli.py; here videos, depth images and crops."""

import os
import resource
import shutil
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.cli import main
from calib.errors import InputError
from calib.importing.from_video import sharpest_frames
from calib.io.depth_image import depth_image_for, read_depth_image
from calib.io.folder_lock import lock_folder
from calib.io.output_folder import LEDGER, OutputFolder
from calib.progress import Silent
from fixtures.known import known
from fixtures.synthetic import scene

W, H = 410, 308
FRAMES = 5


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("undistort")
    known(scene(1, views=1, grid=(8, 8), amplitude=3e-5), W, H).save(folder / "calibration")
    cv2.imwrite(str(folder / "a.png"), ramp(0))
    cv2.imwrite(str(folder / "b.png"), ramp(1))
    return folder


def ramp(shift: int) -> np.ndarray:
    """Smooth, so that a video's compression hardly changes it: by 4 grey levels in colour,
    measured.
    """
    sideways, downwards = np.meshgrid(np.linspace(40, 200, W), np.linspace(0, 40, H))
    return np.dstack([sideways + shift, sideways + downwards, 255 - sideways - shift]).astype(
        np.uint8
    )


def write_video(path: Path, codec: str, rate: float = 25.0) -> Path:
    """Write a video of FRAMES pictures, which FFmpeg may tell of on stderr."""
    writer = cv2.VideoWriter(
        str(path), cv2.CAP_FFMPEG, cv2.VideoWriter.fourcc(*codec), rate, (W, H)
    )
    for shift in range(FRAMES):
        writer.write(ramp(12 * shift))
    writer.release()
    return path


def run(folder: Path, *arguments: object) -> int:
    return main(["undistort", str(folder / "calibration"), *map(str, arguments)])


@pytest.mark.parametrize("suffix", [".mp4", ".avi", ".mkv", ".MOV"])
def test_a_video_is_straightened_frame_by_frame(
    folder: Path, tmp_path: Path, suffix: str, capsys: pytest.CaptureFixture[str]
) -> None:
    video = tmp_path / f"v{suffix}"
    writer = cv2.VideoWriter(
        str(video), cv2.VideoWriter.fourcc(*("MJPG" if suffix == ".avi" else "mp4v")), 12.5, (W, H)
    )
    for shift in range(FRAMES):
        writer.write(ramp(12 * shift))
    writer.release()
    assert run(folder, video, "--depth", "0.5", "-o", tmp_path / "out") == 0
    captured = capsys.readouterr()
    assert captured.out == f"{tmp_path / 'out' / video.name}\n"
    assert f"{FRAMES}/{FRAMES}" in captured.err, "the bar counts frames"
    assert {path.name for path in (tmp_path / "out").iterdir()} == {video.name, LEDGER}
    undistorter = Undistorter(Calibration.load(folder / "calibration"), 0.5)
    made = cv2.VideoCapture(str(tmp_path / "out" / video.name))
    assert made.get(cv2.CAP_PROP_FPS) == pytest.approx(12.5)
    inner = (
        cv2.erode(undistorter.valid.astype(np.uint8), np.ones((17, 17))) > 0
    )  # compression works in blocks of 16
    for shift in range(FRAMES):
        readable, frame = made.read()
        assert readable
        assert (
            np.abs(frame.astype(float) - undistorter.undistort(ramp(12 * shift)))[inner].mean() < 6
        )
    assert not made.read()[0]


@pytest.mark.parametrize(
    ("suffix", "codec"),
    [(".webm", "VP80"), (".MTS", "mp4v"), (".mpg", "MPG2"), (".wmv", "WMV2"), (".3gp", "mp4v")],
)
def test_a_video_of_a_type_that_is_not_written_becomes_mp4(
    folder: Path, tmp_path: Path, suffix: str, codec: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """FFmpeg promises twice the frames of the .MTS, whose rate it guesses."""
    video = write_video(tmp_path / f"v{suffix}", codec, 12.0 if suffix == ".MTS" else 25.0)
    capfd.readouterr()
    assert run(folder, video, "--depth", "0.5", "-o", tmp_path / "out") == 0
    assert capfd.readouterr().out == f"{tmp_path / 'out' / 'v.mp4'}\n"
    made = cv2.VideoCapture(str(tmp_path / "out" / "v.mp4"))
    assert made.get(cv2.CAP_PROP_FRAME_COUNT) == FRAMES
    shutil.copy(video, tmp_path / "v.mp4")
    both = (video, tmp_path / "v.mp4")
    assert run(folder, *both, "--depth", "0.5", "-o", tmp_path / "new") == 2
    assert "would both become v.mp4" in capfd.readouterr().err
    assert len(list(sharpest_frames(video, 60, Silent()))) == FRAMES


def test_a_quoted_pattern_names_the_pictures_that_match(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--depth", "0.5", "-o", tmp_path / "out")
    assert run(folder, folder / "[ab].p*", *options) == 0
    written = capsys.readouterr().out.split()
    assert written == [str(tmp_path / "out" / name) for name in ("a.png", "b.png")]
    assert run(folder, folder / "*.jpg", *options) == 2
    assert f"No picture matches {folder / '*.jpg'}: give a folder" in capsys.readouterr().err


def test_a_session_has_its_pictures_in_frames(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "s" / "frames").mkdir(parents=True)
    cv2.imwrite(str(tmp_path / "s" / "frames" / "a.png"), ramp(0))
    assert run(folder, tmp_path / "s", "--depth", "0.5", "-o", tmp_path / "out") == 0
    assert (tmp_path / "out" / "a.png").is_file()


def test_a_picture_of_another_size_in_a_folder_is_left_out(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    inputs = tmp_path / "in"
    inputs.mkdir()
    cv2.imwrite(str(inputs / "a.png"), np.zeros((48, 64), np.uint8))
    options = ("--depth", "0.5", "-o", tmp_path / "out")
    assert run(folder, inputs, *options) == 2, "none is of the size of the calibration"
    assert "a.png: the picture is 64x48 px where" in capsys.readouterr().err
    cv2.imwrite(str(inputs / "b.png"), ramp(0))
    assert run(folder, inputs, *options) == 0
    captured = capsys.readouterr()
    assert captured.out.split() == [str(tmp_path / "out" / "b.png")]
    assert "left out: " in captured.err
    assert "a.png: the picture is 64x48 px where the calibration is for 410x308" in captured.err
    assert run(folder, inputs / "a.png", inputs / "b.png", *options) == 2, "it was named"


def test_a_folder_may_hold_videos_and_pictures(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    inputs = tmp_path / "in"
    inputs.mkdir()
    cv2.imwrite(str(inputs / "a.png"), ramp(0))
    writer = cv2.VideoWriter(str(inputs / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (W, H))
    writer.write(ramp(0))
    writer.release()
    assert (
        run(
            folder,
            inputs,
            "--depth",
            "0.5",
            "--crop",
            "0",
            "--size",
            "200x150",
            "-o",
            tmp_path / "out",
        )
        == 0
    )
    assert capsys.readouterr().out.split() == [
        str(tmp_path / "out" / name) for name in ("a.png", "v.avi")
    ]
    picture = cv2.imread(str(tmp_path / "out" / "a.png"))
    assert picture is not None
    assert picture.shape == (150, 200, 3)
    assert (picture > 0).all(), "crop 0 leaves no pixel that is not seen"
    readable, frame = cv2.VideoCapture(str(tmp_path / "out" / "v.avi")).read()
    assert readable
    assert frame.shape == (150, 200, 3)


def test_a_truncated_video_is_straightened_up_to_its_end(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video = tmp_path / "v.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), 10, (W, H))
    for _ in range(60):
        writer.write(ramp(0))
    writer.release()
    data = video.read_bytes()
    video.write_bytes(data[: len(data) // 3])
    cv2.imwrite(str(tmp_path / "w.png"), ramp(0))
    out = tmp_path / "out"
    assert run(folder, video, tmp_path / "w.png", "--depth", "0.5", "-o", out) == 3
    captured = capsys.readouterr()
    assert captured.out.split() == [str(out / "v.avi"), str(out / "w.png")], "the others go on"
    frames = int(cv2.VideoCapture(str(out / "v.avi")).get(cv2.CAP_PROP_FRAME_COUNT))
    assert 15 < frames < 25
    assert f"v.avi breaks off after {frames} of 60 frames, which were straightened" in captured.err


@pytest.mark.parametrize("suffix", [".mp4", ".avi", ".mkv"])
def test_a_video_on_a_full_disk_is_an_error_and_leaves_the_earlier_one(
    folder: Path, tmp_path: Path, suffix: str, capfd: pytest.CaptureFixture[str]
) -> None:
    """OpenCV's writer says nothing of it. A file of at most 4 KB stands for the disk."""
    video = write_video(tmp_path / f"v{suffix}", "MJPG" if suffix == ".avi" else "mp4v")
    arguments = (video, "--depth", "0.5", "-o", tmp_path / "out")
    assert run(folder, *arguments) == 0
    earlier = (tmp_path / "out" / video.name).read_bytes()
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    try:
        assert run(folder, *arguments) == 2
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert f"v{suffix} cannot be written, the disk took " in capfd.readouterr().err
    assert (tmp_path / "out" / video.name).read_bytes() == earlier
    assert {path.name for path in (tmp_path / "out").iterdir()} == {video.name, LEDGER}


def test_a_video_of_a_type_that_is_not_read_is_converted_first(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video = tmp_path / "my film.h264"
    video.touch()
    advice = f"convert it by `ffmpeg -i '{video}' '{video.with_suffix('.mp4')}'`.\n"
    assert run(folder, video, "--depth", "0.5", "-o", tmp_path / "out") == 2
    assert capsys.readouterr().err.endswith(advice)
    assert main(["fit", str(video), "--board", "9x6", "--square-mm", "20"]) == 2
    assert capsys.readouterr().err.endswith(advice)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"no video", "holds no frame that can be decoded: replace it, or convert it by `ffmpeg"),
        (None, "No such file"),
    ],
)
def test_a_file_that_is_no_video_gets_a_sentence(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    content: bytes | None,
    says: str,
) -> None:
    if content:
        (tmp_path / "v.mp4").write_bytes(content)
    assert run(folder, tmp_path / "v.mp4", "--depth", "0.5", "-o", tmp_path / "out") == 2
    assert says in capsys.readouterr().err
    assert not list((tmp_path / "out").glob("*"))


def test_a_video_of_another_size_is_refused(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    writer = cv2.VideoWriter(str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 10, (64, 48))
    writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    assert run(folder, tmp_path / "v.avi", "--depth", "0.5", "-o", tmp_path / "out") == 2
    assert (
        "v.avi: the picture is 64x48 px where the calibration is for 410x308"
        in capsys.readouterr().err
    )


@pytest.mark.parametrize("kind", ["npy", "png", "folder"])
def test_a_depth_image_gives_each_pixel_its_depth(
    folder: Path, tmp_path: Path, kind: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Half of the picture near, half far, a stripe unknown: as if straightened twice and put
    together.
    """
    depth = np.full((H, W), 0.3, np.float32)
    depth[:, W // 2 :] = 2.0
    depth[:20] = 0
    depth_file = tmp_path / "depth.npy"
    if kind == "npy":
        np.save(depth_file, depth.astype(np.float64))
    else:
        depth_file = tmp_path / "a.png"
        cv2.imwrite(str(depth_file), (1000 * depth).astype(np.uint16))
    if kind == "folder":
        cv2.imwrite(str(tmp_path / "b.png"), np.full((H, W), 2000, np.uint16))
        depth_file = tmp_path
    assert (
        run(
            folder,
            folder / "a.png",
            folder / "b.png",
            "--depth-image",
            depth_file,
            "-o",
            tmp_path / "both",
        )
        == 0
    )
    for metres in ("0.3", "2"):
        assert (
            run(
                folder,
                folder / "a.png",
                folder / "b.png",
                "--depth",
                metres,
                "-o",
                tmp_path / metres,
            )
            == 0
        )
    capsys.readouterr()
    first_near = read(tmp_path / "both" / "a.png")
    near = read(tmp_path / "0.3" / "a.png")
    far = read(tmp_path / "2" / "a.png")
    second_near = read(tmp_path / "both" / "b.png")
    other_far = read(tmp_path / "2" / "b.png")
    assert np.abs(first_near[20:, : W // 2] - near[20:, : W // 2]).max() <= 1
    assert np.abs(first_near[20:, W // 2 :] - far[20:, W // 2 :]).max() <= 1
    assert (first_near[:20] == 0).all()
    assert np.abs(near - far).max() > 1
    if kind == "folder":
        assert np.abs(second_near - other_far).max() <= 1


def read(path: Path) -> np.ndarray:
    image = cv2.imread(str(path))
    assert image is not None
    return image.astype(int)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--depth-image", "none.npy"], "none.npy cannot be read"),
        (["--depth-image", "small.npy"], "the depth image is float32 of shape (5, 5)"),
        (["--depth-image", "."], "holds no depth image for c.png"),
    ],
)
def test_a_wrong_depth_image_gets_its_sentence(
    folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    says: str,
) -> None:
    np.save(tmp_path / "small.npy", np.ones((5, 5)))
    picture = folder / "a.png"
    if "." in arguments:
        picture = folder / "c.png"
        cv2.imwrite(str(picture), ramp(0))
    assert run(folder, picture, arguments[0], tmp_path / arguments[1], "-o", tmp_path / "out") == 2
    assert says in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "pixels"),
    [("a.png", np.zeros((4, 4), np.uint8)), ("a.png", np.zeros((4, 4, 3), np.uint16))],
)
def test_a_file_that_is_no_depth_image_gets_a_sentence(
    tmp_path: Path, name: str, pixels: np.ndarray
) -> None:
    cv2.imwrite(str(tmp_path / name), pixels)
    with pytest.raises(InputError, match="is not a depth image"):
        read_depth_image(tmp_path / name)
    (tmp_path / "b.npy").write_bytes(b"nonsense")
    with pytest.raises(InputError, match="is not a depth image"):
        read_depth_image(tmp_path / "b.npy")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--depth", "1", "--crop", "2"], "'2' is not from 0 to 1"),
        (["--depth", "1", "--crop", "wide"], "'wide' is not from 0 to 1"),
        (["--depth", "1", "--size", "12"], "'12' is not a size"),
        (["--depth", "1", "--depth-image", "d.npy"], "not allowed with"),
    ],
)
def test_wrong_usage_gets_a_sentence(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], says: str
) -> None:
    with pytest.raises(SystemExit) as stop:
        run(folder, folder / "a.png", *arguments, "-o", folder / "out")
    assert stop.value.code == 2
    assert says in capsys.readouterr().err


def test_a_depth_image_without_a_depth_is_remarked_on(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.save(tmp_path / "d.npy", np.zeros((H, W), np.float32))
    depth = ("--depth-image", tmp_path / "d.npy", "-o", tmp_path / "out")
    assert run(folder, folder / "a.png", *depth) == 0
    assert "Take care: the depth image has no depth" in capsys.readouterr().err


def test_a_depth_image_of_an_impossible_name_gets_its_sentence() -> None:
    with pytest.raises(InputError, match="File name too long"):
        depth_image_for(Path("a.png"), Path("x" * 300))


def test_two_commands_at_once_take_turns_and_replace_nothing_of_each_other(
    folder: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    command = [sys.executable, "-m", "calib", "undistort", str(folder / "calibration")]
    options = ["--depth", "0.5", "-o", str(out)]
    out.mkdir()
    held = lock_folder(out)
    assert held is not None
    waiting = [
        subprocess.Popen(
            [*command, str(folder / name), *options], stderr=subprocess.PIPE, text=True
        )
        for name in ("a.png", "b.png")
    ]
    for process in waiting:
        assert process.stderr
        assert "another calib writes to" in process.stderr.readline()
    OutputFolder(out).write("a.png", b"of the one that was first")
    os.close(held)
    sentence = waiting[0].communicate()[1]
    remarks = waiting[1].communicate()[1]
    assert [process.returncode for process in waiting] == [2, 0], remarks
    assert f"Another calib has written {out / 'a.png'} since this one began: give" in sentence
    assert (out / "a.png").read_bytes() == b"of the one that was first"
    assert (out / "b.png").is_file()
    assert run(folder, folder / "a.png", *options) == 0, "it may be replaced from now on"
