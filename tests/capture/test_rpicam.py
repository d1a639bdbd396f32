"""The rpicam source against a program that speaks rpicam-vid's format: rows padded to 64 bytes,
YUV420, remarks on stderr.
"""

import sys
import time
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.session.shutter import Shutter
from capture.errors import CaptureError
from capture.frames import Frame
from capture.reader import Reader
from capture.rig.rig_reader import RigReader
from capture.rig.rig_sources import open_sources
from capture.session_file import read_setup
from capture.sources import rpicam
from capture.sources.registry import SCHEMES, open_source
from tests.capture.recordings import capture, noise, read_pictures

STAND_IN = """#!{python} -S
import pathlib, signal, sys, time
here = pathlib.Path(__file__).parent
if sys.argv[1:] == ["--help"]:
    print((here / "help").read_text() if (here / "help").exists() else "--camera arg")
    sys.exit(0)
script = (here / "script").read_text().split()
(here / "arguments").write_text(" ".join(sys.argv[1:]))
option = dict(zip(sys.argv[1:], sys.argv[2:]))
width, height = int(option["--width"]), int(option["--height"])
print("[0:08:35.2] [1961]  INFO Camera camera.cpp:1028 configuring streams: (0) %dx%d-YUV420" % (width, height), file=sys.stderr)
print("[0:08:35.3] [1964]  INFO RPI vc4.cpp:565 Sensor: /base/soc/i2c0mux/i2c@1/imx296@1a - Selected sensor format: 1456x1088-SBGGR10_1X10"
    " - Selected unicam format: 1456x1088-pBAA", file=sys.stderr)
grey = (here / "grey").read_bytes()
stride = (width + 63) // 64 * 64
frames = []
for at in range(0, len(grey), width * height):
    rows = [grey[at + y * width : at + (y + 1) * width] + bytes([170]) * (stride - width) for y in range(height)]
    frames.append(b"".join(rows) + bytes([85]) * (2 * (stride // 2) * (height // 2)))
for word in script:
    if word == "synchronise":  # a client waits for the server, as the real program does
        (here / option["--sync"]).touch()
        while not (here / "server").exists() or not (here / "client").exists():
            time.sleep(0.01)
    elif word.isdecimal():
        print("#%s (10.00 fps) exp 7998.00 ag 1.12 dg 1.00" % word, file=sys.stderr, flush=True)
        time.sleep(0.02)
        sys.stdout.buffer.write(frames[int(word)])
    elif word == "half":
        sys.stdout.buffer.write(frames[0][: len(frames[0]) // 2])
    elif word == "fail":
        print("\\x1b[1;31mERROR: *** no cameras available ***\\x1b[0m", file=sys.stderr)
        print("bye", file=sys.stderr)
        sys.stdout.flush()
        sys.exit(255)
    elif word == "other":
        print("configuring streams: (0) 96x48-YUV420", file=sys.stderr, flush=True)
        time.sleep(0.05)
    elif word == "stubborn":
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    elif word == "hang":
        sys.stdout.flush()
        time.sleep(60)
    sys.stdout.flush()
"""  # noqa: E501
"""A stand-in that follows its script: it sends pictures by number, half of one, fails, or hangs."""

WIDTH, HEIGHT = 100, 48
PICTURES = noise(3, WIDTH, HEIGHT)
SOURCE = f"rpicam:0?size={WIDTH}x{HEIGHT}&exposure_us=8000&gain=1&lens_position=2.0&fps=20"


def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the stand-in, which is on the PATH."""
    folder = tmp_path / "bin"
    folder.mkdir()
    (folder / "rpicam-vid").write_text(STAND_IN.format(python=sys.executable))
    (folder / "rpicam-vid").chmod(0o755)
    (folder / "grey").write_bytes(b"".join(picture.tobytes() for picture in PICTURES))
    monkeypatch.setenv("PATH", str(folder), prepend=":")
    return folder


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return stand_in(tmp_path, monkeypatch)


def frames_of(program: Path, script: str) -> list[Frame]:
    (program / "script").write_text(script)
    frames = []
    with open_source(SOURCE) as source:
        assert source.live
        for frame in source:
            frames.append(frame)
    return frames


def same(frames: list[Frame], pictures: list[NDArray[np.uint8]]) -> bool:
    return len(frames) == len(pictures) and all(
        np.array_equal(f.pixels, p) for f, p in zip(frames, pictures, strict=True)
    )


def test_the_grey_plane_is_kept_without_its_padding(program: Path) -> None:
    frames = frames_of(program, "0 1 2")
    assert same(frames, PICTURES)
    assert [frame.sequence for frame in frames] == [0, 1, 2]
    assert frames[-1].metadata == {
        "exposure_us": 7998.0,
        "gain": 1.12,
        "lens_position": 2.0,
        "awbgains": "1.8 1.6",
    }
    assert not np.shares_memory(frames[0].pixels, frames[1].pixels)


def test_in_colour_the_padding_is_left_out_and_grey_stays_grey(program: Path) -> None:
    """The stand-in's colours are 85 everywhere, in full range: less blue and less red than grey."""
    (program / "script").write_text("0 1")
    with open_source(f"{SOURCE}&colour=yes") as source:
        pixels = next(iter(source)).pixels.astype(int)
    y = PICTURES[0].astype(int)
    expected = [y + 1.772 * -43, y - 0.34414 * -43 - 0.71414 * -43, y + 1.402 * -43]  # BT.601
    assert pixels.shape == (HEIGHT, WIDTH, 3)
    np.testing.assert_allclose(pixels, np.clip(np.dstack(expected), 0, 255), atol=1)


def test_the_shutter_of_the_sensor_that_the_program_names_is_written(
    program: Path, tmp_path: Path
) -> None:
    (program / "script").write_text("0 1 2")
    done = capture(
        "record",
        "--source",
        SOURCE,
        "--board",
        "9x9",
        "--square-mm",
        "20",
        "--all",
        tmp_path / "session",
    )
    assert done.returncode == 0, done.stderr
    _, camera, _ = read_setup(tmp_path / "session" / "session.yaml")
    assert camera.shutter == Shutter(rolling=False)
    assert "camera.shutter" not in done.stderr


def test_everything_is_locked_from_the_start(program: Path) -> None:
    frames_of(program, "0")
    text = (program / "arguments").read_text()
    for option in (
        "--nopreview --timeout 0 --camera 0 --codec yuv420 --flush",
        f"--width {WIDTH} --height {HEIGHT} --framerate 20",
        (
            "--autofocus-mode manual --lens-position 2 --shutter 8000 --gain 1 --awbgains 1.8,1.6"
            " --denoise off --output -"
        ),
    ):
        assert option in text
    (program / "script").write_text("0")
    with open_source(SOURCE + "&mode=3280:2464:10:P"):
        pass
    assert "--mode 3280:2464:10:P" in (program / "arguments").read_text()


@pytest.mark.parametrize(
    ("options", "fixed"),
    [
        ("auto=yes", ""),
        ("auto=yes&gain=2", "--gain 2 "),
        ("auto=yes&exposure_us=900&awbgains=1,2", "--shutter 900 --awbgains 1,2 "),
        ("auto=no", "--shutter 8000 --gain 1 --awbgains 1.8,1.6 "),
    ],
)
def test_what_is_automatic_follows_the_light_and_the_focus_does_not(
    program: Path, options: str, fixed: str
) -> None:
    (program / "script").write_text("0 1")
    with open_source(f"rpicam:0?size={WIDTH}x{HEIGHT}&{options}") as source:
        assert next(iter(source))
    words = f"--autofocus-mode manual --lens-position 0 {fixed}--denoise off"
    assert words in (program / "arguments").read_text()


def test_a_truncated_last_frame_is_dropped(program: Path) -> None:
    assert same(frames_of(program, "0 1 half"), PICTURES[:2])


@pytest.mark.parametrize(
    ("script", "says"),
    [
        (
            "fail",
            r"ended with exit code 255 \(it said: ERROR: \*\*\* no cameras available \*\*\*\)",
        ),
        ("0 half fail", r"ended with exit code 255 in the middle of a picture \(it said: ERROR"),
        ("half", r"ended before its first picture \(it said: .*Selected sensor format"),
        ("0 hang", r"has sent nothing for 1\.6 s"),
        ("other 0", r"pictures of 96x48 px: write \?size=96x48"),
    ],
)
def test_errors_are_reported_in_the_program_s_own_words(
    program: Path, script: str, says: str
) -> None:
    start_s = time.monotonic()
    with pytest.raises(CaptureError, match=says):
        frames_of(program, script)
    assert time.monotonic() - start_s < 4


@pytest.mark.parametrize("script", ["0 1 hang", "stubborn 0 1 hang"])
def test_close_ends_the_program(program: Path, script: str) -> None:
    (program / "script").write_text(script)
    with Reader(open_source(SOURCE)) as reader:
        for frame in reader:
            if frame.sequence == 1:
                process = reader.source._process  # type: ignore[attr-defined]
                reader.close()
    assert process.poll() is not None


def test_a_recording_through_the_command(program: Path, tmp_path: Path) -> None:
    (program / "script").write_text("0 1 2 half fail")
    done = capture(
        "record",
        tmp_path / "session",
        "--source",
        SOURCE,
        "--board",
        "9x6",
        "--square-mm",
        "20",
        "--all",
    )
    assert done.returncode == 4
    assert "no cameras available" in done.stderr.splitlines()[-1]
    recorded = read_pictures(tmp_path / "session" / "frames")
    assert 1 <= len(recorded) <= 3
    assert all(any(np.array_equal(picture, p) for p in PICTURES) for picture in recorded)
    assert "Safe in" in done.stderr


RIG = [
    f"{name}=rpicam:{number}?size={WIDTH}x{HEIGHT}&fps=20"
    for number, name in enumerate(("left", "right"))
]


def test_the_cameras_of_a_rig_wait_for_each_other(program: Path) -> None:
    """Both must be open before one has a picture."""
    (program / "help").write_text("  --sync arg (=off)   server or client\n")
    (program / "script").write_text("synchronise 0 1 2")
    with RigReader(open_sources(RIG)) as reader:
        moments = list(reader)
    assert moments
    remarks = [" ".join(source.remarks) for source in reader.sources.values()]
    assert "its frames set the time" in remarks[0]
    assert "begin when those of the camera with sync=server do" in remarks[1]


def test_a_synchronised_camera_of_unknown_sensor_gives_pictures(
    program: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Versions of the program may name it in other words: the wait for the name ends."""
    monkeypatch.setattr(rpicam, "NAME_TIMEOUT", 0.3)
    text = (program / "rpicam-vid").read_text()
    (program / "rpicam-vid").write_text(text.replace("Selected sensor format", "Chosen format"))
    (program / "script").write_text("0 1 hang")
    with open_source(f"{SOURCE}&sync=server") as source:
        assert source.shutter is None
        assert same([next(iter(source))], PICTURES[:1])


@pytest.mark.parametrize(
    ("help_text", "options"),
    [("--camera arg", ("", "")), ("--sync arg", ("&fps=10", "&fps=20"))],
)
def test_cameras_that_cannot_be_synchronised_run_freely(
    program: Path, help_text: str, options: tuple[str, str]
) -> None:
    (program / "help").write_text(help_text)
    texts = [
        f"{name}=rpicam:{number}?size={WIDTH}x{HEIGHT}{option}"
        for number, (name, option) in enumerate(zip(("left", "right"), options, strict=True))
    ]
    assert not any(source.remarks for source in open_sources(texts).values())


def test_a_client_without_a_server_says_what_it_waits_for(program: Path) -> None:
    (program / "script").write_text("fail")
    with (
        pytest.raises(CaptureError, match="waits for a camera of which the source says sync=serv"),
        open_source(f"{SOURCE}&sync=client") as source,
    ):
        list(source)


def test_cameras_are_listed_with_their_modes(program: Path) -> None:
    (program / "rpicam-hello").write_text(
        "#!/bin/sh\ncat <<'END'\nAvailable cameras\n-----------------\n"
        "0 : imx219 [3280x2464 10-bit RGGB] (/base/soc/i2c0mux/i2c@1/imx219@10)\n"
        "    Modes: 'SRGGB10_CSI2P' : 640x480 [206.65 fps - (1000, 752)/1280x960 crop]\n"
        "                             1640x1232 [41.85 fps - (0, 0)/3280x2464 crop]\n"
        "1 : imx708 [4608x2592 10-bit RGGB] (/base/soc/i2c0mux/i2c@0/imx708@1a)\nEND\n"
    )
    (program / "rpicam-hello").chmod(0o755)
    backend = next(scheme for scheme in SCHEMES if scheme.name == "rpicam").backend()
    first, second = backend.inventory().cameras
    assert (first.source, first.name, first.modes) == (
        "rpicam:0",
        "imx219",
        ("640x480 206.65 fps", "1640x1232 41.85 fps"),
    )
    assert (second.source, second.name) == ("rpicam:1", "imx708")
    (program / "rpicam-hello").write_text("#!/bin/sh\necho No cameras available!\n")
    assert "sees no camera: check its cable" in backend.inventory().missing
