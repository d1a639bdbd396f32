"""Calibrate the same corners with this project, the paper's procedure, OpenCV, mrcal and lensboy,
and compare.

Errors are px RMS on views that were not trained on, with each view's pose refitted: "test" at the
training depths, 0.6-1.2 m, and "near" at 0.15-0.3 m with boards partly in the picture. A whole
command is what a person types, with as many threads as it likes, the report or the uncertainty's
map included. mrcal is found where Debian puts it: apt-get install mrcal python3-mrcal. lensboy is
found on PYTHONPATH: pip install --no-deps --target FOLDER lensboy.
"""

import argparse
import os
import platform
import shutil
import subprocess
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from statistics import median

import torch
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from benchmarks.peers.child import Report, start
from benchmarks.peers.scenes import GLASSES, make
from calib.commands.console import Bars
from calib.threads import single_thread

DEBIAN = "/usr/bin/python3"
SPLINED = "SPLINED_STEREOGRAPHIC_order=3_Nx={}_Ny={}_fov_x_deg=75"

OURS = "refracal joint fit, 8x8"
OUR_COMMAND = "refracal calib fit, whole command"
PEERS = (
    (OURS, "refracal", "joint 8 cpu"),
    ("refracal joint fit, 12x12", "refracal", "joint 12 cpu"),
    ("paper's procedure, 8x8", "refracal", "paper 8 cpu"),
    ("OpenCV, 5 coefficients", "opencv", "5"),
    ("OpenCV, 8", "opencv", "8"),
    ("OpenCV, 14", "opencv", "14"),
    ("mrcal OPENCV8", "mrcal", "OPENCV8"),
    ("mrcal splined 8x7", "mrcal", SPLINED.format(8, 7)),
    ("mrcal splined 10x8", "mrcal", SPLINED.format(10, 8)),
    ("lensboy, 14 coefficients", "lensboy", "opencv"),
    ("lensboy splined 8x7", "lensboy", "splined 8 7"),
    ("lensboy splined 10x8", "lensboy", "splined 10 8"),
    (OUR_COMMAND, "calib_fit", ""),
    ("refracal calib fit, told only a cone", "calib_fit", "shape"),
    ("mrcal OPENCV8, whole command", "mrcal", "command OPENCV8"),
    ("mrcal splined 10x8, whole command", "mrcal", f"command {SPLINED.format(10, 8)}"),
)
"""The name in the table, the module, and what that is told.

Ours comes first: the others are divided by it.
"""


COLUMNS = (
    ("test\npx", ".3f", True),
    ("near\npx", ".3f", True),
    ("fit\ns", ".2f", True),
    ("process\ncpu s", ".1f", False),
    ("peak\nMB", ".0f", True),
    ("steps", ".0f", True),
)
"""Head, format, and whether a column with the ratio to ours follows."""
CPU = 3
"""The index of the process's time in COLUMNS."""
Row = tuple[float | None, ...]
"""One number for each of COLUMNS."""


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.peers", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="only the first scene")
    parser.add_argument(
        "--seeds",
        type=int,
        default=1,
        metavar="N",
        help="scenes of each kind; figures are medians; by default 1",
    )
    parser.add_argument(
        "--opencv",
        metavar="PYTHON",
        help="a Python with another OpenCV, numpy and scipy, to be added",
    )
    options = parser.parse_args()
    if options.seeds < 1:
        parser.error("--seeds must be at least 1")
    missing = {"mrcal": _mrcal_missing(), "lensboy": _lensboy_missing()}
    peers = [
        (name, DEBIAN if module == "mrcal" else sys.executable, module, which)
        for name, module, which in PEERS
        if not missing.get(module)
    ]
    if torch.cuda.is_available():
        peers.append(
            ("refracal joint fit, 12x12, on the GPU", sys.executable, "refracal", "joint 12 cuda")
        )
    if options.opencv:
        program = shutil.which(options.opencv)
        if not program:
            parser.error(
                f"--opencv: {options.opencv} is not a program; give the path of a Python"
                " interpreter"
            )
        peers += [
            (f"the other {name}", str(Path(program).absolute()), module, which)
            for name, module, which in PEERS
            if module == "opencv"
        ]
    glasses = GLASSES[:1] if options.quick else GLASSES
    versions = {f"Python {platform.python_version()}"}
    console = Console(width=130)
    with Bars() as bars:
        advance = bars.task("Peers", len(glasses) * len(peers))
        for i, glass in enumerate(glasses):
            with single_thread():
                cases = [make(glass, seed) for seed in range(1, options.seeds + 1)]
            test = median(floor[0] for _, floor in cases)
            near = median(floor[1] for _, floor in cases)
            rows: dict[str, Row] = {"true glass (the floor)": (test, near, None, None, None, None)}
            for j, (name, python, module, which) in enumerate(peers):
                advance(i * len(peers) + j, name)
                reports = [start(python, module, which, case) for case, _ in cases]
                done = [report for report in reports if isinstance(report, Report)]
                versions |= {report.version for report in done}
                rows[name] = _medians(done)
                for complaint in sorted({report for report in reports if isinstance(report, str)}):
                    console.print(
                        f"{name}, {len(reports) - len(done)} of {len(reports)} fits failed:"
                        f" {complaint}"
                    )
            console.print(_table(str(glass), rows))
            for line in _commands(rows):
                console.print(line)
        advance(len(glasses) * len(peers), "")
    console.print(
        f"{', '.join(sorted(versions))}; {platform.machine()}, {os.cpu_count()} processors, every"
        " fit but whole commands on one thread."
    )
    for sentence in filter(None, missing.values()):
        console.print(sentence)


def _mrcal_missing() -> str | None:
    result = shutil.which("mrcal-calibrate-cameras") and shutil.which(DEBIAN)
    if (
        result
        and subprocess.run(
            [DEBIAN, "-c", "import mrcal, scipy"], capture_output=True, check=False
        ).returncode
        == 0
    ):
        return None
    return (
        "mrcal is not installed, so it is left out: on Debian or Ubuntu, apt-get install mrcal"
        " python3-mrcal."
    )


def _lensboy_missing() -> str | None:
    if find_spec("lensboy"):
        return None
    return (
        "lensboy is not installed, so it is left out: pip install --no-deps --target FOLDER"
        " lensboy, and PYTHONPATH=FOLDER."
    )


def _medians(reports: list[Report]) -> Row:
    columns = [(r.test, r.near, r.seconds, r.cpu, r.memory, r.iterations) for r in reports]
    return tuple(
        None if None in column else median(column) for column in zip(*columns, strict=True)
    ) or (None,) * len(COLUMNS)


def _commands(rows: dict[str, Row]) -> Iterator[str]:
    """Yield sentences that compare whole commands."""
    own_seconds = rows[OUR_COMMAND][CPU]
    for name, row in rows.items():
        if (
            name.endswith("whole command")
            and name != OUR_COMMAND
            and own_seconds
            and (seconds := row[CPU])
        ):
            yield (
                f"{OUR_COMMAND}, its report included: {own_seconds:.2f} s of cpu,"
                f" {own_seconds / seconds:.2f} times {name}, {seconds:.2f} s."
            )


def _table(title: str, rows: dict[str, Row]) -> Table:
    table = Table("", title=title, title_justify="left", box=SIMPLE_HEAD)
    for head, _, compared in COLUMNS:
        for text in (head, "x\nours")[: 1 + compared]:
            table.add_column(text, justify="right")
    for name, row in rows.items():
        cells = [name]
        for value, reference, (_, form, compared) in zip(row, rows[OURS], COLUMNS, strict=True):
            cells.append("" if value is None else format(value, form))
            if compared:
                cells.append(
                    ""
                    if value is None or reference is None
                    else f"{value / reference:.2f}"
                    if value < 10 * reference
                    else f"{value / reference:.0f}"
                )
        table.add_row(*cells)
    return table


if __name__ == "__main__":
    main()
