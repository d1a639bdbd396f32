"""`calib stream` as a person runs it: ffmpeg at the pipe's end, a closed pipe, Ctrl-C, and a
sentence for what is wrong.
"""

import json
import shutil
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calib.calibration import Calibration
from calib.cli import main
from capture.sources.video import VideoSource
from capture.streaming.statistics import StreamStatistics
from capture.streaming.straightener import Straightener
from capture.streaming.stream import Stream
from capture.streaming.view import StreamView
from fixtures.known import known
from fixtures.synthetic import scene
from tests.capture.recordings import write_recording
from tests.capture.streaming.conftest import COUNT, SIZE
from tests.capture.streaming.listening import HANGS_S, Remarks
from tests.capture.streaming.test_stream import Album

HOUR = 108_000
"""The frames of an hour at 30 a second."""
WARM = 10_000
"""The frames after which libraries have all memory that they keep."""


def ffmpeg() -> str:
    """Return the program, of the system or of the package imageio-ffmpeg; skip without it."""
    if found := shutil.which("ffmpeg"):
        return found
    package = pytest.importorskip("imageio_ffmpeg", reason="ffmpeg is not installed")
    return str(package.get_ffmpeg_exe())


def streaming(saved: Path, source: object, *options: str) -> subprocess.Popen[bytes]:
    command = [sys.executable, "-m", "calib", "stream", str(saved), "--depth", "0.5", "--json"]
    return subprocess.Popen(
        [*command, "--source", str(source), *options],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        bufsize=0,  # a line is read without what follows it
    )


def result_of(text: bytes) -> dict[str, Any]:
    """Return the JSON object of the last line."""
    result: dict[str, Any] = json.loads(text.decode().splitlines()[-1])
    return result


def test_ffmpeg_reads_the_pictures(
    saved: Path,
    recording: Path,
    calibration: Calibration,
    pictures: list[np.ndarray],
) -> None:
    stream = streaming(saved, recording, "--to", "-", "--quiet")
    reader = subprocess.run(
        [ffmpeg(), "-v", "error", "-i", "-", "-f", "rawvideo", "-pix_fmt", "bgr24", "-"],
        stdin=stream.stdout,
        capture_output=True,
        check=False,
        timeout=HANGS_S,
    )
    errors = stream.communicate(timeout=HANGS_S)[1]
    assert stream.returncode == 0, errors
    assert reader.returncode == 0, reader.stderr
    assert reader.stderr == b""
    frames = np.frombuffer(reader.stdout, np.uint8).reshape(COUNT, SIZE[1], SIZE[0], 3)
    undistorter = StreamView(0.5).undistorter(calibration)
    for frame, picture in zip(frames, pictures, strict=True):
        difference = np.abs(frame.astype(int) - undistorter.undistort(picture)).mean()
        assert difference < 3, "grey levels, of half the colours"
    assert len(errors.splitlines()) == 1, "the result, and no remark"
    result = result_of(errors)
    assert (result["frames"], result["frames_passed_over"]) == (COUNT, 0)
    assert result["ended"] == "source"
    assert result["view"] == {"depth": 0.5, "crop": None, "scale": 1.0}
    assert 0 < result["latency_ms"]["median"] <= result["latency_ms"]["maximum"]


def test_a_depth_for_each_pixel(saved: Path, recording: Path, tmp_path: Path) -> None:
    path = tmp_path / "depth.png"
    cv2.imwrite(str(path), np.full(SIZE[::-1], 500, np.uint16))
    stream = streaming(saved, recording, "--to", "-", "--pixels", "raw", "--depth-image", str(path))
    straight, errors = stream.communicate(timeout=HANGS_S)
    assert stream.returncode == 0, errors
    assert len(straight) == COUNT * SIZE[0] * SIZE[1] * 3
    result = result_of(errors)
    assert (result["frames"], result["depth_images"]) == (COUNT, 1)
    assert result["view"] == {"depth": 0.5, "crop": None, "scale": 1.0}, "of unknown pixels"


@pytest.fixture
def camera(pictures: list[np.ndarray], tmp_path: Path) -> Path:
    """A recording that is played like a camera, for a minute."""
    return write_recording(tmp_path, 15 * pictures, 0.5)


@pytest.mark.slow
def test_a_reader_that_closes_the_pipe_ends_the_stream(saved: Path, camera: Path) -> None:
    stream = streaming(saved, camera, "--to", "-")
    assert stream.stdout
    assert stream.stderr
    assert stream.stdout.read(10) == b"YUV4MPEG2 "
    stream.stdout.close()
    assert stream.wait(HANGS_S) == 0
    assert result_of(stream.stderr.read())["ended"] == "reader"
    stream.stderr.close()


def test_ctrl_c_ends_the_stream(saved: Path, camera: Path) -> None:
    stream = streaming(saved, camera, "--to", "-", "--scale", "0.5")
    assert stream.stdout
    header = stream.stdout.readline()
    assert header.startswith(b"YUV4MPEG2 W164 H124 ")
    stream.send_signal(signal.SIGINT)
    pictures, errors = stream.communicate(timeout=HANGS_S)
    assert stream.returncode == 0, errors
    result = result_of(errors)
    assert result["ended"] == "interrupted"
    frame_bytes = len(b"FRAME\n") + 164 * 124 * 3 // 2
    assert len(pictures) == result["frames"] * frame_bytes, "no frame is cut"


@pytest.mark.slow
@pytest.mark.skipif(not shutil.which("tmux"), reason="tmux is not installed")
def test_the_window_in_a_real_terminal(saved: Path, camera: Path, tmp_path: Path) -> None:
    from tests.capture.tui.test_terminal import Tmux  # a file that is skipped without tmux

    command = [sys.executable, "-m", "calib", "stream", str(saved), "--depth", "0.5"]
    options = ["--source", str(camera), "--to", "window", "--json"]
    terminal = Tmux(tmp_path / "socket", [*command, *options])
    try:
        terminal.see("straight at 0.5 m, crop as the camera, scale 1, 328x246 px")
        terminal.press("Up")
        terminal.see("straight at 0.55 m")
        terminal.press("q")
        terminal.see('"ended": "interrupted"')
    finally:
        terminal.hang_up()


@pytest.mark.slow
def test_http_prints_its_address_and_the_result_on_stdout(saved: Path, camera: Path) -> None:
    pytest.importorskip("aiohttp", reason="the extra `serve` is not installed")
    stream = streaming(saved, camera, "--to", "http:0")
    assert stream.stderr
    line = stream.stderr.readline().decode()
    address = line.split()[-1]
    with urllib.request.urlopen(address.replace("/?", "/state?"), timeout=HANGS_S) as answer:
        state = json.load(answer)
    assert state["size"] == list(SIZE)
    stream.send_signal(signal.SIGINT)
    output, errors = stream.communicate(timeout=HANGS_S)
    assert stream.returncode == 0, errors
    assert json.loads(output)["ended"] == "interrupted"


@pytest.mark.parametrize(
    ("options", "code", "sentence"),
    [
        (("--to", "htp"), 2, "--to htp names no target (did you mean http?): write v4l2:/dev/"),
        (("--to", "http:x"), 2, "'x' is not a port: write a whole number up to 65535"),
        (("--to", "-", "--to", "window"), 2, "both need stdout: leave one of them out"),
        (("--to", "http", "--to", "http:8081"), 2, "--to names http twice: name it once"),
        (("--to", "window"), 2, "This is not a terminal, which --to window needs"),
        (("--to", "v4l2:/dev/video77"), 4, "/dev/video77 is not there: make it by sudo modprobe"),
        (("--to", "/dev/video77"), 4, "/dev/video77 is not there: make it by sudo modprobe"),
        (("--to", "http:0", "--scale", "9"), 2, "scale is 9: write a number from 0.05 to 4"),
        (("--to", "http:0", "--source", "no"), 2, "--source no names no kind of source"),
        (("--to", "http:0", "--source", "folder:/no"), 2, "/no"),
        (("--to", "http:0", "--source", "video:a.mcap"), 2, "a.mcap is a recording of ROS: `calib"),
    ],
)
def test_wrong_usage_is_one_sentence(
    saved: Path,
    recording: Path,
    capsys: pytest.CaptureFixture[str],
    options: tuple[str, ...],
    code: int,
    sentence: str,
) -> None:
    command = ["stream", str(saved), "--depth", "0.5", "--source", str(recording)]
    assert main([*command, *options]) == code
    error = capsys.readouterr().err
    assert sentence in error
    assert error.count("calib: error: ") == 1


def test_a_video_that_breaks_off_is_counted_all_the_same(
    saved: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 30, SIZE)
    for level in range(40):
        writer.write(np.full((*SIZE[::-1], 3), level, np.uint8))
    writer.release()
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    command = ["stream", str(saved), "--depth", "0.5", "--source", f"video:{path}"]
    assert main([*command, "--to", "-"]) == 2
    *_, counts, error = capsys.readouterr().err.splitlines()
    frames = int(error.split("breaks off after ")[1].split()[0])
    assert 10 < frames < 30
    assert counts.startswith(f"{frames} frames, ")


def test_without_the_package_http_says_what_to_install(
    saved: Path,
    recording: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.delitem(sys.modules, "capture.streaming.web_target", raising=False)
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    command = ["stream", str(saved), "--depth", "0.5", "--source", str(recording)]
    assert main([*command, "--to", "http:0"]) == 2
    assert "--to http needs one more package: " in capsys.readouterr().err


def resident_bytes() -> int:
    return 4096 * int(Path("/proc/self/statm").read_text().split()[1])


@pytest.mark.slow
@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the memory is read from Linux")
def test_an_hour_neither_grows_in_memory_nor_loses_count(tmp_path: Path) -> None:
    """A recorded hour at 30 frames a second, as fast as it can be read. One kilobyte that is kept
    of each frame would be 98 MB.
    """
    film = tmp_path / "hour.mp4"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"mp4v"), 30, (64, 48))
    for number in range(HOUR):
        writer.write(np.full((48, 64, 3), number % 256, np.uint8))
    writer.release()
    memory: list[int] = []
    remarks = Remarks()

    def sample(counts: StreamStatistics) -> None:
        if counts.frames in (WARM, HOUR):
            memory.append(resident_bytes())

    remarks.on_frame = sample
    small = known(scene(3, views=1, grid=(4, 4), amplitude=1e-5), 64, 48)
    counter = Counter()
    straightener = Straightener(small, StreamView(0.5))
    stream = Stream(lambda: VideoSource(film), straightener, [counter], remarks)
    assert stream.run() == "source"
    counts = stream.statistics
    assert counts.frames == counter.count == HOUR
    assert counts.skipped == counts.camera_losses == counts.interruptions == 0
    grown = memory[1] - memory[0]
    assert grown < 8 << 20, f"{grown >> 10} kB more after an hour"


class Counter(Album):
    """A target that keeps nothing."""

    count = 0

    def show(self, picture: np.ndarray) -> None:
        self.count += picture.shape == (48, 64, 3)
