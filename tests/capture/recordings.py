"""Small recordings for the tests, and the command `capture`."""

import io
import subprocess
import sys
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.session.board import Board
from capture.cli import main

FIXTURE = Path(__file__).parents[2] / "fixtures" / "bumps"
BOARD = Board(9, 9, 0.02)
BOARD_FLAGS = ("--board", "9x9", "--square-mm", "20")


def noise(count: int, width: int = 160, height: int = 120) -> list[NDArray[np.uint8]]:
    """Return (height, width) pictures that all differ."""
    rng = np.random.default_rng(5)
    return [rng.integers(0, 256, (height, width), np.uint8) for _ in range(count)]


def write_recording(
    folder: Path,
    pictures: Sequence[NDArray[np.uint8]],
    interval_s: float | None = None,
    gains: str = "",
) -> Path:
    """Write a session's frames/, and frames.csv if there is an interval; `gains` is one more
    column, named gain.
    """
    (folder / "frames").mkdir(parents=True)
    rows = ["file,time_s,sequence,gain"]
    for index, picture in enumerate(pictures):
        cv2.imwrite(str(folder / "frames" / f"{index:04d}.png"), picture)
        rows.append(f"{index:04d}.png,{1000 + index * (interval_s or 0)},{index},{gains}")
    if interval_s is not None:
        (folder / "frames.csv").write_text("\n".join(rows) + "\n")
    return folder


def read_pictures(folder: Path) -> list[NDArray[np.uint8]]:
    """Return every picture of a folder, in order; each must be complete."""
    read = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted(folder.glob("*.png"))]
    assert all(picture is not None for picture in read)
    return [np.asarray(picture, np.uint8) for picture in read]


def capture(*arguments: object, **options: object) -> subprocess.CompletedProcess[str]:
    """Run `capture ARGUMENTS`: in this process, or in one of its own where `options` of
    `subprocess.run` are given.
    """
    words = [*map(str, arguments)]
    if options:
        options = {"capture_output": True, "text": True, **options}
        command = [sys.executable, "-m", "capture", *words]
        return subprocess.run(command, check=False, **options)  # type: ignore[call-overload, no-any-return]
    printed, remarked = io.StringIO(), io.StringIO()
    with redirect_stdout(printed), redirect_stderr(remarked):
        try:
            code = main(words)
        except SystemExit as stop:  # argparse
            code = int(stop.code or 0)
    return subprocess.CompletedProcess(words, code, printed.getvalue(), remarked.getvalue())
