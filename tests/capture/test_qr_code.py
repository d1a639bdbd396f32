"""The code in the terminal, as a camera reads it: drawn from its letters and colours, and read by
OpenCV.
"""

import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("segno", reason="the extra `serve` is not installed")
pytest.importorskip("textual_serve", reason="the extra `serve` is not installed")

from capture.qr_code import BORDER, INK, PLAIN, qr_code
from tests.capture.tui.test_serve import free_port

HALVES = {" ": (0, 0), "▀": (1, 0), "▄": (0, 1), "█": (1, 1)}
MODULE = 8  # px


def seen(lines: list[str]) -> NDArray[np.uint8]:
    """Draw these lines as a terminal of any colours does: their ink is black, their ground
    white.
    """
    assert all(line.startswith(INK) and line.endswith(PLAIN) for line in lines)
    cells = np.array(
        [
            [HALVES[letter] for letter in line.removeprefix(INK).removesuffix(PLAIN)]
            for line in lines
        ]
    )
    modules = cells.transpose(0, 2, 1).reshape(2 * len(lines), -1)
    return np.asarray(255 * (1 - np.kron(modules, np.ones((MODULE, MODULE)))), np.uint8)


@pytest.mark.parametrize(
    "address", ["http://192.168.178.123:8000/?token=" + "aB3_" * 8, "http://[fe80::1]:99/"]
)
def test_a_camera_reads_the_address(address: str) -> None:
    picture = seen(qr_code(address).splitlines())
    assert cv2.QRCodeDetector().detectAndDecode(picture)[0] == address
    assert (picture[: BORDER * MODULE] == 255).all()
    picture[: len(picture) // 2] = 255  # what is spoilt is not read
    assert cv2.QRCodeDetector().detectAndDecode(picture)[0] != address


def test_serving_a_phone_shows_the_code_of_the_printed_address(tmp_path: Path) -> None:
    command = [
        sys.executable,
        "-m",
        "capture",
        str(tmp_path / "session"),
        "--serve",
        "--host",
        "0.0.0.0",
        "--port",
        str(free_port()),
    ]
    ours, theirs = pty.openpty()
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=theirs,
        text=True,
        env=os.environ | {"PYTHONUTF8": "1"},
    ) as process:
        os.close(theirs)
        assert process.stdout
        address = process.stdout.readline().strip()
        text = ""
        while "Ctrl-C ends it." not in text:
            text += os.read(ours, 1 << 16).decode(errors="replace")
        process.terminate()
    os.close(ours)
    lines = [line for line in re.split(r"\r?\n", text) if line.startswith(INK)]
    assert cv2.QRCodeDetector().detectAndDecode(seen(lines))[0] == address
