"""rig.yaml: what is read, and the one sentence that a mistake gets."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.cli import main
from calib.commands.rig_lines import print_rig
from calib.corners.view import View
from calib.errors import InputError
from calib.rig.placements import Placements
from calib.rig.rig import Rig
from calib.rig.rig_file import read_rig

GOOD: dict[str, object] = {
    "format": 1,
    "cameras": {"left": "left", "right": "right"},
    "reference": "left",
    "together": "by_name",
}


@pytest.fixture
def folder(pair_folder: Path, tmp_path: Path) -> Path:
    """A folder with links to the sessions of the pair, in which each test writes its rig.yaml."""
    for name in ("left", "right"):
        (tmp_path / name).symlink_to(pair_folder / name)
    return tmp_path


def written(folder: Path, changes: Mapping[str, object]) -> Path:
    content = {key: value for key, value in {**GOOD, **changes}.items() if value is not None}
    (folder / "rig.yaml").write_text(yaml.safe_dump(content))
    return folder


def test_a_rig_is_read_from_its_folder_or_file(folder: Path) -> None:
    written(folder, {"baseline_mm": {"value": 60.0, "sigma": 0.5}})
    for path in (folder, folder / "rig.yaml"):
        rig = read_rig(path)
        assert list(rig.sessions) == ["left", "right"]
        assert (rig.reference, rig.tolerance_s) == ("left", None)
        assert rig.baseline
        assert (rig.baseline.value, rig.baseline.sigma) == (0.06, 0.0005)
    assert folder / "left" / "corners.vnl" in rig.files
    tolerance = read_rig(written(folder, {"together": {"tolerance_ms": 5}})).tolerance_s
    assert tolerance == 0.005


MISTAKES: dict[str, tuple[dict[str, object], str]] = {
    "unknown key": ({"camera": {}}, "camera is not a known key (did you mean cameras?)"),
    "no format": ({"format": None}, "format is missing: write 1"),
    "other reference": ({"reference": "middle"}, "write one of the cameras: left, right"),
    "no together": ({"together": None}, "together is missing: write by_name, or {tolerance_ms: 5}"),
    "wrong together": ({"together": "by_time"}, "write by_name, or {tolerance_ms: 5}"),
    "negative tolerance": ({"together": {"tolerance_ms": -1}}, "together.tolerance_ms is -1"),
    "no cameras": ({"cameras": {}}, "write one to 64 cameras"),
    "list of cameras": ({"cameras": ["left"]}, "cameras is a list of 1: write a mapping"),
    "path as a name": ({"cameras": {"../left": "left"}}, "has the name '../left'"),
    "missing session": ({"cameras": {"left": "left", "right": "rigth"}}, "rigth does not exist"),
    "number for a folder": ({"cameras": {"left": 1}}, "cameras.left is 1"),
    "one session twice": (
        {"cameras": {"left": "left", "right": "left/../left"}},
        "names the session left/../left twice, for left and for right",
    ),
    "baseline without sigma": ({"baseline_mm": 60.0}, "{value: 60.0, sigma: 0.5}"),
    "exact baseline": ({"baseline_mm": {"value": 60.0, "sigma": 0}}, "with its standard deviation"),
    "baseline in metres": (
        {"baseline_mm": {"value": 0.06, "sigma": 0.001}},
        "(0.06 m, if metres were meant, is 60)",
    ),
    "shared cover of nobody": ({"shared_cover": [["left", "third"]]}, "shared_cover names third"),
    "shared cover of one": ({"shared_cover": [["left"]]}, "such as [[left, right]]"),
}


@pytest.mark.parametrize(("changes", "sentence"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_gets_one_sentence(
    changes: dict[str, object],
    sentence: str,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = folder / "out"
    code = main(["rig", "fit", str(written(folder, changes)), "-o", str(out)])
    captured = capsys.readouterr()
    assert code == 2
    assert captured.out == ""
    lines = [line for line in captured.err.splitlines() if not line.startswith("  ")]
    assert len(lines) == 1, "a list of what may be written is indented"
    assert sentence in captured.err
    assert "rig.yaml" in captured.err or "session" in captured.err
    assert not out.exists()


def test_a_missing_rig_says_what_to_write(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rig", "fit", str(tmp_path), "-o", str(tmp_path / "out")]) == 2
    assert "rig.yaml does not exist: write a rig.yaml, at the least {format: 1" in (
        capsys.readouterr().err
    )


@pytest.mark.parametrize("name", ["", "session.yaml"])
def test_a_session_of_one_camera_is_no_rig(
    folder: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    session = written(folder, {}) / "left"
    assert main(["rig", "fit", str(session / name)]) == 2
    assert capsys.readouterr().err == (
        f"calib: error: {session} is a session of one camera, and no rig: `calib fit {session}`"
        f" calibrates the camera, or give its rig, {folder / 'rig.yaml'}.\n"
    )


def test_boards_must_be_the_same(folder: Path, tmp_path: Path) -> None:
    session = tmp_path / "other"
    session.mkdir()
    content = yaml.safe_load((folder / "right" / "session.yaml").read_text())
    content["board"]["square_mm"] = 31.0
    (session / "session.yaml").write_text(yaml.safe_dump(content))
    (session / "corners.vnl").write_text((folder / "right" / "corners.vnl").read_text())
    written(folder, {"cameras": {"left": "left", "right": "other"}})
    sentence = (
        "left has a 6x5 board with a square of 30 mm, and right a 6x5 board with a square of 31 mm"
    )
    with pytest.raises(InputError, match=sentence):
        read_rig(folder)


def view(name: str, time_s: float | None = None, pose_id: str | None = None) -> View:
    return View(name, np.zeros((4, 2)), np.ones(4), time_s, pose_id)


def test_pictures_of_one_name_show_one_placement(folder: Path) -> None:
    rig = read_rig(written(folder, {}))
    views = {
        "left": (view("a.png"), view("b.png"), view("c.png")),
        "right": (view("b.jpg"), view("d.png"), view("a.png")),
    }
    placements = Placements.of(rig, views)
    assert placements.names == ("a.png", "b.png", "c.png", "d.png")
    assert placements.of_views["left"].tolist() == [0, 1, 2]
    assert placements.of_views["right"].tolist() == [1, 3, 0]


def test_a_still_board_has_one_placement(folder: Path) -> None:
    rig = read_rig(written(folder, {}))
    views = {
        "left": (view("a.png", pose_id="a"), view("b.png", pose_id="a")),
        "right": (view("b.png"),),
    }
    placements = Placements.of(rig, views)
    assert placements.count == 1


def test_pictures_within_the_tolerance_show_one_placement(folder: Path) -> None:
    rig = read_rig(written(folder, {"together": {"tolerance_ms": 20}}))
    views = {
        "left": (view("1", 0.0), view("2", 1.0), view("3", 1.03)),
        "right": (view("1", 0.015), view("2", 1.02), view("3", 2.0)),
    }
    placements = Placements.of(rig, views)
    assert placements.of_views["left"].tolist() == [0, 1, 2]
    assert placements.of_views["right"].tolist() == [0, 2, 3], "the nearest one, each once"


def test_a_tolerance_needs_times(folder: Path) -> None:
    rig = read_rig(written(folder, {"together": {"tolerance_ms": 20}}))
    with pytest.raises(
        InputError, match=r"view-1 of left has no time: list time_s in .*frames.csv"
    ):
        Placements.of(rig, {"left": (view("view-1"),), "right": ()})


def test_a_fit_and_its_evaluation_by_the_command(
    pair_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["rig", "fit", str(pair_folder), "-o", str(out), "--grid", "1x1", "--json", "-q"]
    assert main(words) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["reference"] == "left"
    assert result["cameras"]["left"]["sigma"] == [0.0] * 6
    assert np.shape(result["cameras"]["right"]["T_camera_reference"]) == (4, 4)
    (baseline,) = result["baselines"]
    assert (baseline["from"], baseline["to"]) == ("left", "right")
    assert abs(baseline["metres"]["value"] - 0.06) < 0.004
    assert all(Path(path).is_file() for path in result["written"])
    report = (out / "report.html").read_text()
    for text in (
        "The rig in space",
        "left to right",
        "Errors by depth",
        '"others":[{"name":"right"',
    ):
        assert text in report
    assert result["verdict"]["word"] in ("trusted", "care")
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    assert main(["rig", "evaluate", str(out), str(pair_folder), "--json"]) == 0
    evaluation = json.loads(capsys.readouterr().out)
    assert evaluation["rms_px"] < 0.16
    for band in evaluation["lengths"]:
        assert {"from_m", "to_m", "rms_mm", "sigma_mm"} <= band.keys()
        assert band["rms_mm"] < 2.5 * band["sigma_mm"]
    assert before == {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}
    (out / "left" / "calibration.yaml").write_text("mine")
    assert main(words) == 2
    assert "has changed since calib wrote it" in capsys.readouterr().err
    assert (out / "left" / "calibration.yaml").read_text() == "mine"
    assert (out / "rig_calibration.yaml").read_bytes() == before[out / "rig_calibration.yaml"]


def test_the_fit_says_how_many_placements_are_shared(
    fitted: Rig, capsys: pytest.CaptureFixture[str]
) -> None:
    """A picture whose partner is missing still counts, for its camera alone."""
    of_views = {**fitted.of_views, "right": fitted.of_views["right"][1:]}
    print_rig(replace(fitted, of_views=of_views), 1.0)
    assert "12 placements of the board, 11 of which several cameras saw" in capsys.readouterr().out
