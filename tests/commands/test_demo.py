"""`calib demo`: the numbers of a rendered window, a straight wall, and the report."""

import json
import re
import webbrowser
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from calib.cli import main
from calib.io.output_folder import OutputFolder
from fixtures.housing import INDEX, WINDOW
from fixtures.wall import bend_of_joint

TRUTH = {
    "distance_mm": 1e3 * WINDOW.place,
    "tilt_deg.x": np.rad2deg(WINDOW.turned[0]),
    "tilt_deg.y": np.rad2deg(WINDOW.turned[1]),
    "thickness_mm": 1e3 * WINDOW.thickness,
    "refractive_index": INDEX,
}


@dataclass(frozen=True)
class Run:
    """One run with --json."""

    folder: Path
    result: dict[str, Any]


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Run:
    folder = tmp_path_factory.mktemp("demo") / "refracal-demo"
    with redirect_stdout(StringIO()) as output:
        assert main(["demo", "-o", str(folder), "--json"]) == 0
    return Run(folder, json.loads(output.getvalue()))


def test_it_finds_the_true_window(demo: Run) -> None:
    result = demo.result
    assert result["verdict"]["word"] == "trusted"
    for name, truth in TRUTH.items():
        estimate = result["cover"][name]
        # one of a thousand fits is off by more than 3.3 standard deviations
        assert abs(estimate["value"] - truth) < 3.3 * estimate["sigma"], name
    errors = {stage["name"]: stage["rms_px"] for stage in result["stages"]}
    assert errors["pinhole"] > 100 * errors["cover+rbf"]
    assert errors["cover+rbf"] < 0.02  # the noise of the corners is 0.014 px
    assert Path(result["undistorted"]).is_file()


def test_it_prints_the_commands_and_opens_the_report(
    demo: Run, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A second run replaces what the first one wrote."""
    opened: list[str] = []
    monkeypatch.setattr(webbrowser, "open", opened.append)
    monkeypatch.setenv("DISPLAY", ":0")
    for name in ("SSH_CONNECTION", "SSH_TTY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(demo.folder.parent)
    assert main(["demo", "--quiet"]) == 0
    lines = capsys.readouterr().out.splitlines()
    typed = [line for line in lines if line.startswith("$ ")]
    assert typed[0].endswith(" fit refracal-demo --depth 0.8")
    assert typed[1].endswith("--depth 0.8 --crop 0 -o refracal-demo/straight")
    assert "You can trust this calibration where the board was in the picture." in lines
    assert lines[-2] == "Report: refracal-demo/calibration/report.html"
    assert lines[-1].startswith("Now your own: ")
    assert lines[-1].endswith(" fit PICTURES --board 9x6 --square-mm MM --cover flat")
    assert opened == [(demo.folder / "calibration" / "report.html").as_uri()]


def test_the_wall_is_straight(demo: Run) -> None:
    """The window bends the uppermost horizontal joint of the tiles by many pixels."""
    bent = bend_of_joint(demo.folder / "wall.jpg")
    straight = bend_of_joint(demo.folder / "straight" / "wall.jpg")
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    assert f"bent by {bent:.0f} px, then straight to {straight:.2f} px" in readme
    assert bent > 10  # 19.8 px
    assert straight < 0.3  # 0.16 px: the noise of single pixels


def test_the_stream_of_the_tutorial_is_straight(
    demo: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its program runs as it stands there; the film shows the wall, which is 0.8 m away."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "OUT").symlink_to(demo.folder / "calibration")
    wall = cv2.imread(str(demo.folder / "wall.jpg"))
    assert wall is not None
    film = cv2.VideoWriter("film.mp4", cv2.VideoWriter.fourcc(*"mp4v"), 10, wall.shape[1::-1])
    film.write(wall)
    film.release()
    page = (Path(__file__).parents[2] / "docs" / "tutorial.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    names: dict[str, Any] = {}
    exec(program.replace("depth=0.5", "depth=0.8"), names)
    cv2.imwrite("straight.png", names["straight"])
    assert bend_of_joint(tmp_path / "straight.png") < 0.4  # the film's compression costs 0.1 px


@pytest.mark.parametrize("file", ["calibration.yaml", "calibration/calibration.yaml"])
def test_the_calibration_of_a_camera_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], file: str
) -> None:
    """A file that calib itself wrote for a camera is not replaced either."""
    place = tmp_path / file
    place.parent.mkdir(exist_ok=True)
    OutputFolder(place.parent).write(place.name, "of a camera")
    assert main(["demo", "-o", str(tmp_path), "--no-open"]) == 2
    assert f"{place} is not the demo's: give another folder with -o" in capsys.readouterr().err
    assert place.read_text() == "of a camera"
    assert not (tmp_path / "session.yaml").exists()


def test_a_foreign_file_is_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "session.yaml").write_text("mine")
    assert main(["demo", "-o", str(tmp_path), "--no-open"]) == 2
    assert "session.yaml" in capsys.readouterr().err
    assert (tmp_path / "session.yaml").read_text() == "mine"
    assert [path.name for path in tmp_path.iterdir()] == ["session.yaml"]
