"""`calib report`, the report that `calib fit` leaves, and what the report says of how to fit
again.
"""

import argparse
import errno
import json
import os
import re
import shutil
import subprocess
import sys
import webbrowser
from collections.abc import Callable
from dataclasses import replace
from html import unescape
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.cli import main
from calib.commands import fit_command
from calib.commands.report_command import has_screen
from calib.errors import InputError
from calib.fit_record.history import DiagnosisRecord, History
from calib.fit_record.request import CommandOptions, FitRequest, Provenance, Settings
from calib.fitting.provenance import session_hash
from calib.io.files import UnnamedFile
from calib.report.again import commands, pasted
from calib.session.session import read_session
from fixtures.synthetic import scene
from tests.test_calibration import rewrite_npz, write_session


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return write_session(tmp_path / "session", scene(7, views=6, amplitude=1e-5, noise=0.05))


def test_fit_leaves_a_report(session: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["fit", str(session), "--grid", "4x4"]) == 0
    path = session / "calibration" / "report.html"
    assert f"Wrote {path}" in capfd.readouterr().out
    origin = Calibration.load(path.parent).request.provenance
    assert origin
    assert origin.session == str(session.resolve())
    assert origin.session_sha256
    assert origin.session_sha256 in path.read_text()


@pytest.mark.usefixtures("without_figures")
def test_a_report_that_can_not_be_written_costs_nothing_else(
    session: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: object) -> str:
        raise InputError("report.html cannot be written (No space left on device): free some.")

    monkeypatch.setattr("calib.report.write.page", fail)
    assert main(["fit", str(session), "--grid", "4x4", "--depth", "1", "--json"]) == 2
    out, err = capfd.readouterr()
    assert json.loads(out)["frames_used"] == 6
    assert "report.html cannot be written" in err
    assert "Traceback" not in err
    assert Calibration.load(session / "calibration").views
    assert (session / "calibration" / "map_1m.npz").exists()


@pytest.mark.usefixtures("without_figures")
def test_report_opens_a_browser_where_there_is_a_screen(
    small_calibration: Calibration,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    small_calibration.save(tmp_path)
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    for name in ("SSH_CONNECTION", "SSH_TTY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("DISPLAY", ":0")
    assert main(["report", str(tmp_path / "calibration.yaml")]) == 0
    assert capfd.readouterr().out == f"{tmp_path / 'report.html'}\n"
    assert opened == [(tmp_path / "report.html").as_uri()]
    (tmp_path / "report.html").unlink()
    assert main(["report", str(tmp_path), "--no-open"]) == 0
    assert (tmp_path / "report.html").exists(), "written afresh"
    monkeypatch.setenv("SSH_CONNECTION", "192.0.2.1 5 192.0.2.2 22")
    assert main(["report", str(tmp_path)]) == 0
    assert len(opened) == 1
    assert main(["report", str(tmp_path / "elsewhere")]) == 2
    assert "give the folder that calib fit wrote" in capfd.readouterr().err


@pytest.mark.usefixtures("without_figures")
def test_a_report_beside_a_calibration_that_cannot_be_written_goes_elsewhere(
    small_calibration: Calibration,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    folder = tmp_path / "my disc"
    small_calibration.save(folder)
    original = UnnamedFile.__init__

    def refuse(self: UnnamedFile, place: Path, data: bytes | str) -> None:
        if place == folder:
            raise OSError(errno.EROFS, os.strerror(errno.EROFS))
        original(self, place, data)

    monkeypatch.setattr(UnnamedFile, "__init__", refuse)
    assert main(["report", str(folder)]) == 2
    advice = f"write the report into another folder by `calib report '{folder}' -o report`.\n"
    assert advice in capfd.readouterr().err
    out = tmp_path / "elsewhere"
    assert main(["report", str(folder), "-o", str(out), "--no-open"]) == 0
    assert capfd.readouterr().out == f"{out / 'report.html'}\n"
    html = re.sub("</?span[^>]*>", "", (out / "report.html").read_text())
    assert f"-o {folder}" in unescape(html).replace("'", "")
    assert main(["report", str(folder), "-o", str(out), "--png", str(out)]) == 2


@pytest.mark.parametrize(
    ("environment", "platform", "expected"),
    [
        ({}, "linux", False),
        ({"DISPLAY": ":0"}, "linux", True),
        ({"WAYLAND_DISPLAY": "wayland-0"}, "linux", True),
        ({"DISPLAY": "localhost:10", "SSH_CONNECTION": "a 1 b 2"}, "linux", False),
        ({}, "darwin", True),
        ({"SSH_TTY": "/dev/pts/0"}, "darwin", False),
        ({}, "win32", True),
    ],
)
def test_a_browser_is_opened_only_in_front_of_the_person(
    environment: dict[str, str], platform: str, expected: bool
) -> None:
    assert has_screen(environment, platform) is expected


@pytest.mark.parametrize(
    "settings",
    [
        Settings(),
        Settings(grid=(8, 5), free=("radius", "index"), folds=5),
        Settings(method="paper", grid=(7, 5), steps=250, exact_hit=False),
    ],
)
def test_the_command_asks_for_the_same_fit(settings: Settings) -> None:
    request = FitRequest(
        settings,
        CommandOptions(effects=("board_shape", "focal"), depths=(0.5, 1 / 3)),
        Provenance(session="/there/my session"),
    )
    parser = argparse.ArgumentParser()
    fit_command.add_arguments(parser)
    ((program, verb, *words),) = commands(request, History(), Path("/out"))
    assert (program, verb) == ("calib", "fit")
    args = parser.parse_args(words)
    assert (args.session, args.output) == ([Path("/there/my session")], Path("/out"))
    assert (args.depth, args.effects) == ([0.5, 1 / 3], ("board_shape", "focal"))
    assert (
        Settings(args.method, args.grid, args.steps, not args.neglect_shift, args.free, args.folds)
        == settings
    )


def test_what_is_left_at_its_default_is_not_said() -> None:
    request = FitRequest(Settings(), provenance=Provenance(session="/s"))
    assert commands(request, History(), Path("/out")) == [["calib", "fit", "/s", "-o", "/out"]]
    diagnosed = History(diagnosis=DiagnosisRecord())
    assert commands(request, diagnosed, Path("/out")) == [
        ["calib", "fit", "/s", "--effects", "auto", "-o", "/out"]
    ]


def test_what_lies_at_home_is_found_from_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    line = pasted(["echo", str(tmp_path / "my session"), "/elsewhere/it's", "--free"])
    assert str(tmp_path) not in line
    out = subprocess.run(["sh", "-c", line], capture_output=True, text=True, check=True).stdout
    assert out == f"{tmp_path / 'my session'} /elsewhere/it's --free\n"


@pytest.mark.slow
def test_the_printed_commands_make_the_calibration_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Given by relative paths with spaces, diagnosed with a holdout; then pasted into a shell that
    stands elsewhere.
    """
    monkeypatch.chdir(tmp_path)
    write_session(tmp_path / "my session", scene(7, views=12, amplitude=1e-5, noise=0.05))
    write_session(tmp_path / "held out", scene(8, views=4, amplitude=1e-5, noise=0.05))
    fitted = [
        "fit",
        "my session",
        "--grid",
        "5x4",
        "--free",
        "index",
        "--effects",
        "board_scale",
        "--depth",
        "0.5",
        "0.8",
        "-o",
        "my fit",
    ]
    assert main(fitted) == 0
    assert (
        main(["diagnose", "my fit/calibration.yaml", "--holdout", "held out", "-o", "better one"])
        == 0
    )
    earlier = [Calibration.load(folder) for folder in ("my fit", "better one")]
    html = (tmp_path / "better one" / "report.html").read_text()
    match = re.search(r'<section id="again">.*?<pre>(.*?)</pre>', html, re.DOTALL)
    assert match
    lines = unescape(re.sub("<[^>]*>", "", match[1]))
    assert [line.split()[1] for line in lines.splitlines()] == ["fit", "diagnose"]
    for folder in ("my fit", "better one"):
        shutil.rmtree(folder)
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    subprocess.run(
        ["sh", "-e", "-c", lines],
        cwd=elsewhere,
        env=os.environ | {"PATH": path},
        check=True,
        capture_output=True,
    )
    assert {"map_0.5m.npz", "map_0.8m.npz"} <= {
        made.name for made in (tmp_path / "my fit").iterdir()
    }
    for folder, item in zip(("my fit", "better one"), earlier, strict=True):
        calibration = Calibration.load(folder)
        for name in ("amplitudes", "poses", "covariance"):
            assert np.array_equal(getattr(item, name), getattr(calibration, name)), (
                "on one machine, a fit repeats to the last bit"
            )
        records = item.record(), calibration.record()
        unlike = {key for key, value in records[0].items() if value != records[1][key]}
        assert unlike <= {"made_by", "diagnosis"}, "made_by says when"
        assert (calibration.camera, calibration.cover, calibration.stages) == (
            item.camera,
            item.cover,
            item.stages,
        )


def test_the_session_hash_is_what_sha256sum_gives(tmp_path: Path) -> None:
    cone = {
        "shape": "cone",
        "inner_radius_mm": 42,
        "radius_slope": 0,
        "axis_offset_mm": [0, -30],
        "thickness_mm": 3,
        "refractive_index": 1.5,
    }
    board, camera = {"columns": 9, "rows": 9, "square_mm": 20}, {"width": 64, "height": 48}
    (tmp_path / "session.yaml").write_text(
        yaml.safe_dump({"format": 1, "board": board, "camera": camera, "cover": cone})
    )
    for name in ("frames/b.png", "frames/a.png", "bare/1.png"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        cv2.imwrite(str(tmp_path / name), np.full((48, 64), len(name), np.uint8))
    odd = tmp_path / "frames" / os.fsdecode(b"\xff.png")  # a name that is not UTF-8
    shutil.copy(tmp_path / "frames" / "b.png", odd)
    hash_value = session_hash(read_session(tmp_path))
    shell = "LC_ALL=C; sha256sum bare/1.png frames/*.png session.yaml | sha256sum"
    assert (
        hash_value
        == subprocess.run(
            shell, shell=True, cwd=tmp_path, capture_output=True, text=True, check=True
        ).stdout.split()[0]
    )
    cv2.imwrite(str(tmp_path / "frames" / "a.png"), np.zeros((48, 64), np.uint8))
    assert session_hash(read_session(tmp_path)) != hash_value


@pytest.mark.slow
def test_a_plain_camera_calibration_has_a_report(tmp_path: Path) -> None:
    """Without a cover there is no glass, and no depth to depend on."""
    made = scene(7, views=8, noise=0.05)
    folder = write_session(tmp_path / "session", made)
    document = yaml.safe_load((folder / "session.yaml").read_text())
    document["cover"] = {"shape": "none"}
    (folder / "session.yaml").write_text(yaml.safe_dump(document))
    assert main(["fit", str(folder), "-o", str(tmp_path)]) == 0
    html = (tmp_path / "report.html").read_text()
    assert 'id="glass"' not in html
    assert 'id="by-depth"' not in html
    assert 'id="distortion"' in html


def test_a_calibration_without_views_has_no_report(
    small_calibration: Calibration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nothing = np.zeros((0, 6))
    replace(small_calibration, views=(), poses=nothing, stages=()).save(tmp_path)
    assert main(["report", "--no-open", str(tmp_path)]) == 3
    assert "has no views to report on" in capsys.readouterr().err
    assert not (tmp_path / "report.html").exists()


@pytest.mark.parametrize(
    "changed",
    [
        ("poses", lambda poses: -poses, "do not lie on a board at its pose"),
        ("poses", lambda poses: poses * 0, "do not lie on a board at its pose"),
        ("corners", lambda corners: corners + 1e6, "has a corner outside the picture"),
        ("corners", lambda corners: corners * 0, "its corners lie on one line or point"),
    ],
    ids=["behind the camera", "in the pinhole", "outside the picture", "all in one place"],
)
def test_poses_and_corners_that_do_not_go_with_the_camera(
    small_calibration: Calibration,
    changed: tuple[str, Callable[[NDArray[np.float64]], NDArray[np.float64]], str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    name, change, says = changed
    small_calibration.save(tmp_path)
    with np.load(tmp_path / "calibration.npz") as file:
        array = file[name]
    rewrite_npz(tmp_path, **{name: change(array)})
    assert main(["report", "--no-open", str(tmp_path)]) == 2
    assert says in capsys.readouterr().err
