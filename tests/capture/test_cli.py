"""The command as a person runs it: the kept pictures, exit codes and sentences, and never a
traceback.
"""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.io.frames_table import read_table
from calib.io.images import read_image
from calib.session.session import read_session
from capture.cli import main
from capture.gate import HOLD_STILL, KNOWN_VIEW, MOVING, OUT_OF_FOCUS
from tests.capture.recordings import (
    BOARD_FLAGS,
    FIXTURE,
    capture,
    noise,
    read_pictures,
    write_recording,
)

POSES, REPEATS = (0, 1, 2, 3), 4


@pytest.fixture(scope="module")
def still_poses(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a recording of a board that stands still in one pose after another: each of the
    fixture's pictures four times, 0.1 s apart.
    """
    folder = tmp_path_factory.mktemp("still")
    (folder / "frames").mkdir()
    rows = ["file,time_s,sequence,exposure_us"]
    for index in range(len(POSES) * REPEATS):
        name = f"{index:04d}.jpg"
        shutil.copy(
            FIXTURE / "frames" / f"{POSES[index // REPEATS]:04d}.jpg", folder / "frames" / name
        )
        rows.append(f"{name},{index / 10},{index},8000.0")
    (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    return folder


def pose_of(picture: np.ndarray) -> int:
    """Return the name of the fixture's picture that equals this one, bit for bit."""
    for pose in POSES:
        if np.array_equal(picture, read_image(FIXTURE / "frames" / f"{pose:04d}.jpg")):
            return pose
    raise AssertionError("not a picture of the source")


def test_record_keeps_each_pose_once_and_says_so(still_poses: Path, tmp_path: Path) -> None:
    session = tmp_path / "session"
    cover = FIXTURE / "session.yaml"
    done = capture(
        "record",
        session,
        "--source",
        f"folder:{still_poses}?speed=max",
        *BOARD_FLAGS,
        "--cover-from",
        cover,
    )
    assert done.returncode == 0, done.stderr
    assert [pose_of(picture) for picture in read_pictures(session / "frames")] == list(POSES)
    *lines, summary, next_step = done.stdout.splitlines()
    assert lines == [
        f"{session}/frames/{row['file']}  view {int(row['view']) + 1} of 30"
        for row in read_table(session / "frames.csv")
    ]
    assert summary == f"4 views with 4 pictures (16 frames taken) in {session}."
    assert next_step == f"Next: calib fit {session}"
    sentences = done.stderr.splitlines()
    assert (
        f"Wrote {session}/session.yaml with cover.shape cone: correct it there if the camera's"
        " cover is another." in sentences
    )
    assert len(sentences) <= 1 + 2 * len(POSES)  # a verdict is told when it changes
    described, expected = read_session(session), read_session(FIXTURE)
    assert (described.board, described.camera, described.cover) == (
        expected.board,
        expected.camera,
        expected.cover,
    )
    assert [row["exposure_us"] for row in read_table(session / "frames.csv")] == ["8000.0"] * 4

    second_run = capture("record", session, "--source", f"folder:{still_poses}?speed=max")
    assert second_run.returncode == 3
    assert second_run.stderr.splitlines()[-1].startswith(
        f"capture: error: No frame of folder:{still_poses}?speed=max was kept: "
    )
    assert len(read_pictures(session / "frames")) == 4


def test_a_burst_is_of_one_pose_and_ends_at_the_number_of_views(
    still_poses: Path, tmp_path: Path
) -> None:
    source = f"folder:{still_poses}?speed=max"
    done = capture(
        "record",
        tmp_path,
        "--source",
        source,
        *BOARD_FLAGS,
        "--burst",
        "2",
        "--views",
        "3",
        "--json",
    )
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert list(document) == [
        *(
            "session",
            "pictures",
            "views",
            "frames_judged",
            "frames_passed_over",
            "frames_lost",
            "remarks",
            "ended",
        ),
    ]
    names = {row["file"] for row in read_table(tmp_path / "frames.csv")}
    assert set(document["pictures"]) == {f"frames/{name}" for name in names}
    assert len(names) == 6
    sources = still_poses.glob("frames/*.jpg")
    assert names <= {f"{picture.stem}.png" for picture in sources}, "each keeps its name"
    assert (document["views"], document["ended"], document["frames_passed_over"]) == (3, "views", 0)
    assert [pose_of(picture) for picture in read_pictures(tmp_path / "frames")] == [
        0,
        0,
        1,
        1,
        2,
        2,
    ]
    assert [row["view"] for row in read_table(tmp_path / "frames.csv")] == [
        "0",
        "0",
        "1",
        "1",
        "2",
        "2",
    ]


@pytest.mark.parametrize("interval_s", [None, 0.0, 1.0], ids=["no times", "one time", "far apart"])
def test_photographs_are_judged_each_by_itself(tmp_path: Path, interval_s: float | None) -> None:
    """Nothing shows whether the board was still between two photographs: a spoiled one is left out,
    and none belongs to another's burst.
    """
    photographs = [read_image(FIXTURE / "frames" / f"{pose:04d}.jpg") for pose in (0, 1, 1, 2)]
    photographs[1] = np.asarray(cv2.GaussianBlur(photographs[1], (0, 0), 4), np.uint8)
    source = write_recording(
        tmp_path / "source",
        [np.asarray(photograph, np.uint8) for photograph in (*photographs, photographs[0])],
        interval_s,
    )
    session = tmp_path / "session"
    done = capture(
        "record", session, "--source", f"folder:{source}?speed=max", *BOARD_FLAGS, "--burst", "2"
    )
    assert done.returncode == 0, done.stderr
    assert [pose_of(picture) for picture in read_pictures(session / "frames")] == [0, 1, 2]
    assert [row["sequence"] for row in read_table(session / "frames.csv")] == ["0", "2", "3"]
    assert f"0001.png: {OUT_OF_FOCUS}" in done.stderr.splitlines()
    assert f"0004.png: {KNOWN_VIEW}" in done.stderr.splitlines()


def test_pictures_that_are_near_in_time_are_no_photographs(tmp_path: Path) -> None:
    pictures = [
        np.asarray(read_image(FIXTURE / "frames" / f"{pose:04d}.jpg"), np.uint8) for pose in POSES
    ]
    source = write_recording(tmp_path / "source", pictures, 0.9)
    done = capture(
        "record", tmp_path / "session", "--source", f"folder:{source}?speed=max", *BOARD_FLAGS
    )
    assert done.returncode == 3
    assert done.stderr.splitlines()[:2] == [HOLD_STILL, MOVING]


def test_the_option_every_sets_the_time_between_views(still_poses: Path, tmp_path: Path) -> None:
    done = capture(
        "record",
        tmp_path,
        "--source",
        f"folder:{still_poses}?speed=max",
        *BOARD_FLAGS,
        "--every",
        "0.7",
    )
    assert done.returncode == 0, done.stderr
    times = [float(row["time_s"]) for row in read_table(tmp_path / "frames.csv")]
    assert 2 <= len(times) < len(POSES)
    assert min(np.diff(times)) > 0.699


def test_the_option_all_keeps_every_frame_without_detection(tmp_path: Path) -> None:
    pictures = noise(5)
    source = write_recording(tmp_path / "source", pictures)
    done = capture(
        "record",
        tmp_path / "session",
        "--source",
        f"folder:{source}",
        *BOARD_FLAGS,
        "--all",
        "--views",
        "4",
        "--bare",
    )
    assert done.returncode == 0, done.stderr
    pictures_kept = read_pictures(tmp_path / "session" / "bare")
    assert all(np.array_equal(a, b) for a, b in zip(pictures_kept, pictures[:4], strict=True))


def test_a_covered_folder_recorded_without_cover_is_remarked_on(tmp_path: Path) -> None:
    source = write_recording(tmp_path / "source", noise(2))
    shutil.copy(FIXTURE / "session.yaml", source)
    arguments = (
        "record",
        tmp_path / "session",
        "--source",
        f"folder:{source}",
        *BOARD_FLAGS,
        "--all",
        "--bare",
    )
    done = capture(*arguments)
    assert done.returncode == 0
    assert (
        "says that its pictures have a cover, a cone, where those without the cover are wanted."
        in done.stderr
    )
    (source / "bare").mkdir()
    done = capture(*arguments)
    assert done.returncode == 2
    assert f"for those without, write folder:{source / 'bare'}." in done.stderr


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_ends_with_a_summary(tmp_path: Path, number: signal.Signals) -> None:
    source = write_recording(tmp_path / "source", noise(3), 30.0)
    command = [
        sys.executable,
        "-m",
        "capture",
        "record",
        str(tmp_path / "session"),
        "--source",
        f"folder:{source}",
        *BOARD_FLAGS,
        "--all",
    ]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout
        assert process.stderr
        assert process.stdout.readline().endswith("view 1\n")
        start_s = time.monotonic()
        process.send_signal(number)
        out, err = process.communicate(timeout=600)
        assert process.returncode == 0, err
        assert time.monotonic() - start_s < 3
    assert out.startswith("1 view with 1 picture (1 frame taken)")
    assert "Traceback" not in err
    assert len(read_table(tmp_path / "session" / "frames.csv")) == 1


def test_no_torch_is_loaded_by_a_recording(still_poses: Path, tmp_path: Path) -> None:
    code = (
        "import sys; from capture.cli import main; code = main(sys.argv[1:]); print(code, 'torch'"
        " in sys.modules, 'textual' in sys.modules)"
    )
    command = [
        sys.executable,
        "-c",
        code,
        "record",
        str(tmp_path),
        "--source",
        f"folder:{still_poses}",
        *BOARD_FLAGS,
        "--views",
        "1",
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "0 False False"


def test_help_is_quick() -> None:
    """Importing torch would take 1.5 s, OpenCV 0.15 s; the best of five runs counts, because the
    machine may be busy.
    """
    times = []
    for _ in range(5):
        start_s = time.monotonic()
        done = capture("--help")
        times.append(time.monotonic() - start_s)
        assert done.returncode == 0
        assert "stdout carries the result" in done.stdout
    assert min(times) < 0.3


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (
            ["{}/new", "--source", "folder:{}/source"],
            2,
            "has no session.yaml yet: describe the board by --board COLSxROWS (its inner corners)",
        ),
        (
            ["{}/new", "--source", "folder:{}/source", "--board", "9x9"],
            2,
            "--board and --square-mm belong together: add --square-mm MM, the side of a square;",
        ),
        (
            ["{}/new", "--source", "folder:{}/source", "--square-mm", "20"],
            2,
            "--board and --square-mm belong together: add --board COLSxROWS, the inner corners",
        ),
        (["{}/new", "--source", "camera", *BOARD_FLAGS], 2, "names no kind of source"),
        (
            ["{}/new", "--source", "/dev/video99", *BOARD_FLAGS],
            2,
            "(did you mean v4l2:/dev/video99?)",
        ),
        (
            ["{}/other", "--source", "folder:{}/source", "--cover-from", "{}/flat"],
            2,
            "describes another cover than --cover-from's",
        ),
        (
            ["{}/new", "--source", "v4l2:{}/none", *BOARD_FLAGS],
            4,
            "none is not there: plug the camera in",
        ),
        (["{}/new", "--source", "v4l2:/dev/null", *BOARD_FLAGS], 4, "/dev/null is not a camera"),
        (
            ["{}/new", "--source", "libcamera:0", *BOARD_FLAGS],
            4,
            "sudo apt install -y python3-libcamera",
        ),
        (
            [
                "{}/new",
                "--source",
                "folder:{}/source",
                *BOARD_FLAGS,
                "--cover-from",
                "{}/none.yaml",
            ],
            2,
            "none.yaml cannot be read",
        ),
        (["{}/new", "--source", "folder:{}/source", *BOARD_FLAGS], 3, "was kept: "),
        (
            ["{}/new", "--source", "folder:{}/source", *BOARD_FLAGS, "--all", "--burst", "2"],
            2,
            "choose among good views",
        ),
        (
            ["{}/new", "--source", "folder:{}/source", *BOARD_FLAGS, "--all", "--every", "2"],
            2,
            "choose among good views",
        ),
        (
            [
                "{}/new",
                "--source",
                "folder:{}/source",
                "--board",
                "9x9",
                "--square-mm",
                "0.02",
                "--all",
            ],
            2,
            "write a number from 0.05",
        ),
        (
            ["{}/other", "--source", "folder:{}/source"],
            2,
            "0000.png is 160x120 px where {}/other/session.yaml says 1640x1232",
        ),
        (
            ["{}/other", "--source", "folder:{}/source", "--cover-from", "{}/flat.yaml"],
            2,
            "describes another cover than --cover-from's",
        ),
        (
            ["/dev/null/new", "--source", "folder:{}/source", *BOARD_FLAGS, "--all"],
            2,
            "(Not a directory): choose a place inside a folder",
        ),
        (
            ["{}/file", "--source", "folder:{}/source", *BOARD_FLAGS, "--all"],
            2,
            "cannot be written",
        ),
    ],
)
def test_a_source_that_cannot_be_recorded_gets_one_sentence(
    tmp_path: Path, arguments: list[str], code: int, says: str, capfd: pytest.CaptureFixture[str]
) -> None:
    write_recording(tmp_path / "source", noise(2))
    (tmp_path / "file").write_text("not a folder")
    (tmp_path / "other").mkdir()
    described = (FIXTURE / "session.yaml").read_text()
    (tmp_path / "other" / "session.yaml").write_text(described)
    (tmp_path / "flat.yaml").write_text(described.replace("thickness_mm: 3.0", "thickness_mm: 2.0"))
    (tmp_path / "flat").mkdir()
    shutil.copy(tmp_path / "flat.yaml", tmp_path / "flat" / "session.yaml")
    assert main(["record", *(argument.format(tmp_path) for argument in arguments)]) == code
    out, err = capfd.readouterr()
    assert out == ""
    last = err.splitlines()[-1]
    assert last.startswith("capture: error: ")
    assert says.format(tmp_path) in last
    assert "Traceback" not in err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["record", "x"], "--source"),
        (
            ["record", "x", "--source", "y", "--board", "9"],
            "write its inner corners as two whole numbers from 3, such as 9x6",
        ),
        (["record", "x"], "A whole command is: capture record cam0 --source v4l2:"),
        (["record", "x", "--source", "y", "--square-mm", "0"], "is not a number above 0"),
        (["record", "x", "--source", "y", "--views", "0"], "write a whole number above 0"),
        (["record", "x", "--source", "y", "--every", "inf"], "is not a number above 0"),
    ],
)
def test_wrong_usage_exits_with_2(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert says in capsys.readouterr().err


def test_capture_without_arguments_asks_for_a_folder(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    assert capsys.readouterr().err.startswith(
        "capture: error: name a folder, which is made if need be: capture SESSION"
    )


def test_capture_without_arguments_and_stderr_has_its_exit_code() -> None:
    done = capture(preexec_fn=partial(os.close, 2), stderr=None, capture_output=False)
    assert done.returncode == 2


def test_a_misspelt_command_is_no_session(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["recrd", "cam0"]) == 2
    assert "recrd is not a command: did you mean record?" in capsys.readouterr().err


def test_the_screen_needs_a_terminal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A word that is not the name of a command is a session. pytest has no terminal."""
    folder = tmp_path / "show"
    assert main([str(folder)]) == 2
    assert (
        f"This is not a terminal: run `capture {folder}` in one, or record without a screen:"
        f" `capture record {folder} --source SOURCE`."
    ) in capsys.readouterr().err
    monkeypatch.setenv("TERM", "dumb")
    for stream in (sys.stdin, sys.stdout):
        monkeypatch.setattr(stream, "isatty", lambda: True)
    assert main([str(tmp_path / "show")]) == 2
    assert "This terminal shows no screens (TERM is dumb)" in capsys.readouterr().err
    assert not (tmp_path / "show").exists()


def test_the_command_sources_lists_cameras_and_missing_programs(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    done = capture("sources")
    assert done.returncode == 0, done.stderr
    assert (
        "libcamera: The libcamera bindings are not installed: run sudo apt install -y"
        " python3-libcamera" in done.stdout
    )
    assert (
        "rpicam: rpicam-apps is not installed: on Raspberry Pi OS, run sudo apt install"
        " rpicam-apps." in done.stdout
    )
    document = json.loads(capture("sources", "--json").stdout)
    assert list(document) == ["cameras", "missing"]
    assert {"libcamera", "rpicam"} <= {item["scheme"] for item in document["missing"]}
    assert all(list(item) == ["source", "name", "modes", "problem"] for item in document["cameras"])


def test_an_unreadable_folder_is_reported_before_the_screen_opens(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(folder: Path) -> None:
        raise PermissionError(13, "Permission denied", str(folder))

    monkeypatch.setattr(Path, "iterdir", refuse)  # a test may run as one who may read everything
    assert main(["ui", str(tmp_path)]) == 2
    assert f"{tmp_path} cannot be listed (Permission denied)" in capsys.readouterr().err
    monkeypatch.setattr(Path, "exists", refuse)
    monkeypatch.setattr(Path, "is_dir", lambda _: False)
    assert main(["ui", str(tmp_path)]) == 2
    assert (
        "cannot be read (Permission denied): check its name and permissions."
        in capsys.readouterr().err
    )


@pytest.mark.parametrize("name", ["calibration", "rig_calibration"])
@pytest.mark.parametrize("command", [["record"], []])
def test_a_finished_calibration_is_no_folder_to_record_into(
    command: list[str], name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "my camera" / "calibration"
    folder.mkdir(parents=True)
    results = {f"{name}.yaml", f"{name}.npz"}
    for result in results:
        (folder / result).write_text("format: 2\n")
    arguments = [*command, str(folder), "--source", f"folder:{FIXTURE}"]
    assert main(arguments) == 2
    sentence = f"{folder} holds a finished calibration, not pictures: name a new folder"
    assert sentence in capsys.readouterr().err
    (folder.parent / "session.yaml").write_text("")
    assert main([*arguments, "--board", "9x6"]) == 2
    go_on = f"not pictures: go on with its session: `capture '{folder.parent}'`"
    assert go_on in capsys.readouterr().err
    assert {path.name for path in folder.iterdir()} == results
