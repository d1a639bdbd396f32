"""The blocks of output that pages quote are what the commands print.

A page marks such a block by a comment in front of it: `<!-- printed by: calib demo -->`, and a
command that needs others first joins them by `&&`. A line `...` stands for lines that are left out.
"""

import os
import re
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from calib.calibration import Calibration
from tests.opencv_error import (
    FLAGS,
    error_nearby,
    fit_without_numbers,
    opencv_error,
    opencv_projection,
    refracal_projection,
)

ROOT = Path(__file__).parents[1]
PAGES = (ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")))
PRINTED = re.compile(r"^<!-- printed by: (.+?) -->\n+```\w*\n(.*?)^```$", re.DOTALL | re.MULTILINE)
NUMBER = re.compile(r"[+-]?\d+(?:\.\d+)?")
SECONDS = re.compile(r"\d+\.\d s\.")

QUOTED = [
    (page.relative_to(ROOT).as_posix(), command, block)
    for page in PAGES
    for command, block in PRINTED.findall(page.read_text(encoding="utf-8"))
]


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder in which the commands run; it has the fixtures."""
    folder = tmp_path_factory.mktemp("world")
    for name in ("fixtures", "benchmarks"):
        (folder / name).symlink_to(ROOT / name)
    return folder


@cache
def printed(command: str, folder: Path) -> tuple[str, ...]:
    """The lines that a chain of commands prints on stdout, without blanks at their ends."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "80", "OMP_NUM_THREADS": "1"}
    environment = {key: value for key, value in environment.items() if key != "DISPLAY"}
    lines: list[str] = []
    for part in command.split(" && "):
        words = re.sub(r"^(calib|capture)(?= )", r"python -m \1", part)
        words = re.sub(r"^python(?= )", sys.executable, words)
        done = subprocess.run(
            words,
            shell=True,
            cwd=folder,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode in (0, 5), f"{part}\n{done.stdout[-2000:]}{done.stderr[-2000:]}"
        lines += done.stdout.splitlines()
    return tuple(line.rstrip() for line in lines)


def agrees(quoted: str, line: str) -> bool:
    """True if the words agree, and each number to one unit of its last digit: processors differ in
    it. How long a command took is not compared.
    """
    quoted, line = SECONDS.sub("", quoted), SECONDS.sub("", line)
    if NUMBER.sub("#", " ".join(quoted.split())) != NUMBER.sub("#", " ".join(line.split())):
        return False
    for expected, number in zip(NUMBER.findall(quoted), NUMBER.findall(line), strict=True):
        digits = len(expected.partition(".")[2])
        if abs(float(expected) - float(number)) > 1.01 * 10**-digits:
            return False
    return True


@pytest.mark.slow
@pytest.mark.parametrize(("page", "command", "block"), QUOTED)
def test_a_quoted_block_is_what_the_command_prints(
    page: str, command: str, block: str, world: Path
) -> None:
    lines = list(printed(command, world))
    place = 0
    is_next = False
    for quoted in (line.rstrip() for line in block.splitlines()):
        if quoted == "...":
            is_next = False
            continue
        places = [i for i in range(place, len(lines)) if agrees(quoted, lines[i])]
        output = "\n".join(lines)
        assert places, f"{page}: {quoted!r} is not printed by {command}:\n{output}"
        assert not is_next or places[0] == place, f"{page}: lines are left out before {quoted!r}"
        place = places[0] + 1
        is_next = True


def test_pages_quote_output() -> None:
    assert {page for page, _, _ in QUOTED} >= {"README.md", "docs/calibrating.md"}


def test_another_number_is_noticed() -> None:
    assert agrees("smooth │ 0.197 px", "smooth  │  0.198 px")
    assert not agrees("smooth │ 0.197 px", "smooth │ 0.200 px")
    assert not agrees("smooth │ 0.197 px", "fitted │ 0.197 px")
    assert agrees("8 views, 0.8 s.", "8 views, 12.7 s.")


@pytest.mark.slow
def test_the_lenses_of_opencv_leave_what_the_readme_says(world: Path) -> None:
    printed("calib demo --no-open", world)
    calibration = Calibration.load(world / "refracal-demo" / "calibration" / "calibration.yaml")
    words = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split())
    for count in FLAGS:
        quoted = re.search(rf"([\d.]+) px with {count}\b", words)
        assert quoted
        assert float(quoted[1]) == pytest.approx(opencv_error(calibration, count), abs=1e-3)
    nearby = re.search(r"nearer, OpenCV ([\d.]+), Refracal ([\d.]+)\.", words)
    assert nearby
    assert float(nearby[1]) == pytest.approx(
        error_nearby(opencv_projection(calibration, 14)), abs=0.02
    )
    peers = (ROOT / "docs" / "peers.md").read_text(encoding="utf-8")
    section = peers.partition("## OpenCV on the demo's pictures")[2].partition("\n## ")[0]
    for count in FLAGS:
        row = re.search(rf"OpenCV, {count} coefficients \| ([\d.]+) \| ([\d.]+)", section)
        assert row
        assert float(row[1]) == pytest.approx(opencv_error(calibration, count), abs=1e-3)
        error = error_nearby(opencv_projection(calibration, count))
        assert float(row[2]) == pytest.approx(error, abs=0.02)
    row = re.search(r"Refracal, told the lens and the window \| 0.014 \| ([\d.]+) \|", section)
    assert row
    assert float(row[1]) == pytest.approx(error_nearby(refracal_projection(calibration)), abs=1e-3)
    unmeasured = fit_without_numbers(world / "refracal-demo", world)
    row = re.search(
        r"Refracal, told that there is a window in water \| ([\d.]+) \| ([\d.]+)", section
    )
    assert row
    assert float(row[1]) == pytest.approx(unmeasured.stages[-1].rms_px, abs=1e-3)
    error = error_nearby(refracal_projection(unmeasured))
    assert float(row[2]) == pytest.approx(error, abs=2e-3)
    assert 'Refracal, told only "window, water", 0.014 px' in words
    near = re.search(
        r"Nearer than the boards, OpenCV leaves ([\d.]+) px with 5, ([\d.]+) px with 14,"
        r" Refracal ([\d.]+) px\. ",
        words,
    )
    assert near
    for printed_px, count in zip(near.groups()[:2], FLAGS, strict=True):
        error = error_nearby(opencv_projection(calibration, count))
        assert float(printed_px) == pytest.approx(error, abs=0.02)
    assert near[3] == nearby[2] == row[2]
    assert f"noise | {calibration.noise_px:.3f} |" in section


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "out", "column"),
    [
        ("calib demo --no-open", "refracal-demo/calibration", 0),
        ("calib fit fixtures/bumps -o cone", "cone", 1),
    ],
)
def test_a_wrong_depth_costs_what_the_page_says(
    command: str,
    out: str,
    column: int,
    world: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Its program runs as it stands there, and prints the table's numbers."""
    printed(command, world)
    monkeypatch.chdir(world)
    page = (ROOT / "docs" / "undistorting.md").read_text(encoding="utf-8")
    section = page.partition("## Which depth?")[2].partition("\n## ")[0]
    program = section.partition("```python\n")[2].partition("```")[0]
    rows = re.findall(r"^\| ([\d.]+ m|infinity) \| (.*?) \| (.*?) \|$", section, re.MULTILINE)
    assert len(rows) == 6
    for depth, *cells in rows:
        metres = "np.inf" if depth == "infinity" else depth.removesuffix(" m")
        exec(program.replace("OUT", out).replace("1.0)", f"{metres})"), {})
        found = [float(word) for word in capsys.readouterr().out.split()]
        stated = [float(word) for word in cells[column].split(",")]
        assert found == pytest.approx(stated, abs=0.06), depth
