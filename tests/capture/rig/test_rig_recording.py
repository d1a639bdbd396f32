"""`capture record RIG` with two cameras: what belongs together, what is kept, and what is said."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.corners.detect_all import detect
from calib.io.frames_table import read_table
from calib.rig.placements import Placements
from calib.rig.rig_file import read_rig
from capture.cli import main
from capture.gate import KNOWN_VIEW
from tests.capture.rig.pair_recordings import (
    BOARD_FLAGS,
    ONLY_LEFT,
    REST_S,
    SHARED,
    record,
    resting,
)

PLACES = (*SHARED, ONLY_LEFT)
DURATION_S = len(PLACES) * REST_S
OFFSET_S = 0.008


def times(interval_s: float, offset_s: float = 0.0) -> list[float]:
    return [k * interval_s + offset_s for k in range(round(DURATION_S / interval_s))]


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write what two cameras record at ten frames a second, the right one 8 ms later."""
    folder = tmp_path_factory.mktemp("recordings")
    record(folder / "left", "left", times(0.1), resting(PLACES))
    record(folder / "right", "right", times(0.1, OFFSET_S), resting(PLACES))
    return folder


def sources(folder: Path, **options: str) -> list[str]:
    speed = options.get("speed", "max")
    sources = [f"{name}=folder:{folder / name}?speed={speed}" for name in ("left", "right")]
    return [argument for text in sources for argument in ("--source", text)]


def run(
    rig: Path, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> tuple[int, str, list[str]]:
    code = main(["record", str(rig), *arguments])
    output = capsys.readouterr()
    return code, output.out, output.err.splitlines()


def test_pairs_are_kept_together_and_one_camera_alone_as_such(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "rig"
    code, output, remarks = run(rig, [*sources(recordings), *BOARD_FLAGS], capsys)
    assert code == 0
    *lines, summary, offset, command = output.splitlines()
    assert lines == [
        *(
            f"{rig}/left/frames/{k:04d}.png  {rig}/right/frames/{k:04d}.png  view {k + 1} of 30"
            for k in range(4)
        ),
        f"{rig}/left/frames/0004.png  alone",
    ]
    assert summary == (
        f"4 shared views and 1 view of one camera alone (25 moments judged) in {rig}."
    )
    assert offset == (
        "right is 8.0 ms after left (median); pictures up to 60.0 ms apart belong together."
    )
    assert command == f"Next: calib rig fit {rig} -o {rig}/calibration"
    assert any(line.startswith(f"Wrote {rig}/rig.yaml") for line in remarks)
    description = read_rig(rig)
    assert tuple(description.sessions) == ("left", "right")
    assert description.reference == "left"
    offsets = [
        float(a["time_s"]) - float(b["time_s"])
        for a, b in zip(
            read_table(rig / "right" / "frames.csv"),
            read_table(rig / "left" / "frames.csv"),
            strict=False,
        )
    ]
    assert offsets == pytest.approx(4 * [OFFSET_S], abs=2e-5)

    code, output, remarks = run(rig, sources(recordings), capsys)  # the rig is continued
    assert code == 3
    assert KNOWN_VIEW in remarks
    assert len(list((rig / "right" / "frames").iterdir())) == 4


def test_all_moments_are_kept_though_the_board_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As bursts for a delay between the cameras need it."""

    def moving(time_s: float) -> np.ndarray:
        placement: np.ndarray = SHARED[0] + [0.0, 0.0, 0.0, 0.15 * time_s, 0.0, 0.0]
        return placement

    record(tmp_path / "left", "left", times(0.05)[:8], moving)
    record(tmp_path / "right", "right", times(0.05, OFFSET_S)[:8], moving)
    rig = tmp_path / "rig"
    arguments = [*sources(tmp_path), *BOARD_FLAGS, "--all", "--json"]
    code, output, _ = run(rig, [*arguments, "--views", "6"], capsys)
    assert (code, json.loads(output)["views"]) == (0, 6)
    for name in ("left", "right"):
        assert len(read_table(rig / name / "frames.csv")) == 6
    code, _, remarks = run(rig, [*arguments, "--burst", "2"], capsys)
    assert (code, remarks[-1].startswith("capture: error: --burst and --every choose")) == (2, True)


def test_the_recorded_rig_has_the_placements_that_were_shown(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "rig"
    assert run(rig, [*sources(recordings), *BOARD_FLAGS, "--json"], capsys)[0] == 0
    description = read_rig(rig)
    views = {name: detect(s.frames, s.board).views for name, s in description.sessions.items()}
    placements = Placements.of(description, views)
    assert placements.count == len(PLACES)
    assert [len(index) for index in placements.of_views.values()] == [5, 4]


@pytest.mark.parametrize(
    ("left", "right", "pairs", "tolerance_ms"),
    [
        pytest.param(times(0.05), times(0.125, 0.011), 4, 30.0, id="unequal rates"),
        pytest.param(times(0.1), times(0.1, 0.045), 4, 60.0, id="free running"),
        pytest.param(
            [t for t in times(0.1) if round(t * 10) % 5 != 3], times(0.1), 4, 60.0, id="dropped"
        ),
        pytest.param(times(0.02), times(0.02, 5.0), 0, 12.0, id="no common time"),
    ],
)
def test_times_of_other_rates(
    left: list[float],
    right: list[float],
    pairs: int,
    tolerance_ms: float,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Pictures of one moment are found whatever the rates; the board is known by its times."""
    record(tmp_path / "left", "left", left[:200], resting(PLACES))
    record(tmp_path / "right", "right", right[:200], resting(PLACES))
    rig = tmp_path / "rig"
    code, output, remarks = run(rig, [*sources(tmp_path), *BOARD_FLAGS, "--json"], capsys)
    if not pairs:
        assert code == 3
        assert "none were taken within 12.0 ms of each other" in remarks[-1]
        return
    document = json.loads(output)
    assert (code, document["views"]) == (0, pairs)
    assert document["tolerance_ms"] == pytest.approx(tolerance_ms, abs=0.01)
    tables = [read_table(rig / name / "frames.csv") for name in ("left", "right")]
    for rows in zip(*tables, strict=False):
        assert rows[0]["file"] == rows[1]["file"]
        assert abs(float(rows[0]["time_s"]) - float(rows[1]["time_s"])) <= tolerance_ms / 1000


def test_photographs_without_times_belong_together_by_name(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("left", "right"):
        for k in range(5):
            target = tmp_path / name / f"{k + (name == 'right' and k > 1)}.png"
            target.parent.mkdir(exist_ok=True)
            shutil.copy(recordings / name / "frames" / f"{5 * k:04d}.png", target)
    rig = tmp_path / "rig"
    code, output, _ = run(rig, [*sources(tmp_path), *BOARD_FLAGS, "--json"], capsys)
    document = json.loads(output)
    assert code == 0
    # Of 0 to 4 and 0, 1, 3, 4, 5, pictures 3 and 4 show different places, which the fit tells.
    assert (document["views"], document["frames_unpaired"]) == (4, 1)
    assert document["tolerance_ms"] is None


def test_an_unplugged_camera_ends_the_recording_and_keeps_it(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A picture of the right camera that cannot be read stands for its device."""
    broken = tmp_path / "broken"
    shutil.copytree(recordings, broken)
    (broken / "right" / "frames" / "0012.png").write_bytes(b"")
    rig = tmp_path / "rig"
    code, _, remarks = run(rig, [*sources(broken), *BOARD_FLAGS], capsys)
    assert code == 2
    assert remarks[-1].startswith("capture: error: right: ")
    assert remarks[-2].startswith(f"Safe in {rig}: 3 shared views")
    assert len(list((rig / "right" / "frames").iterdir())) == 3
    assert run(rig, sources(recordings), capsys)[0] == 0
    assert len(list((rig / "right" / "frames").iterdir())) == 4


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--source", "left=folder:a"], "A rig has 2 to 64 cameras, and 1 is named"),
        (["--source", "left=folder:a", "--source", "folder:b"], "folder:b names no camera"),
        (["--source", "left=folder:a", "--source", "left=folder:b"], "the camera left twice"),
        (["--source", "left=folder:a", "--source", "right=folder:a"], "are both folder:a"),
        (["--source", "a=folder:a", "--source", "b=v4l2:/dev/video0"], "no moment in common"),
        (["--source", "a=folder:a", "--source", "b=video:b.mp4"], "b is a video"),
        (["--source", "a=folder:a", "--source", "b=folder:b", "--bare"], "--bare is for one"),
        (["--source", "a=folder:a", "--source", "b=folder:b"], "describes no board yet"),
        (
            [
                *("--source", "a=folder:a", "--source", "b=folder:b", *BOARD_FLAGS),
                *("--cover-from", "c=x.yaml"),
            ],
            "--cover-from names c, which is no camera",
        ),
    ],
)
def test_wrong_rigs_are_refused(
    arguments: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, remarks = run(tmp_path / "rig", arguments, capsys)
    assert code == 2
    assert sentence in remarks[-1]
    assert not (tmp_path / "rig").exists()


def test_pictures_of_unknown_partners_are_not_mixed_in(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = tmp_path / "rig"
    shutil.copytree(recordings / "left", rig / "left")
    code, _, remarks = run(rig, [*sources(recordings), *BOARD_FLAGS], capsys)
    assert code == 2
    assert "says which pictures of the other cameras belong to them" in remarks[-1]
    file = rig / "rig.yaml"
    file.write_text("format: 1\n")
    code, _, remarks = run(rig, ["--source", str(recordings / "left")], capsys)
    assert code == 2
    assert "is the folder of a rig" in remarks[-1]
    content = {"format": 1, "cameras": {"top": "top", "left": "left"}, "reference": "top"}
    file.write_text(yaml.safe_dump(content))
    code, _, remarks = run(rig, [*sources(recordings), *BOARD_FLAGS], capsys)
    assert code == 2
    assert "has the cameras left, top where --source names left, right" in remarks[-1]
