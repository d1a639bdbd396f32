"""Twenty kills of a recording: what was there stays, and the same command goes on."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("aiohttp", reason="the extra `serve` is not installed")

from calib.session.session import read_session
from capture.screen.points_session import PointsSession

KILLS = 20
POSES = 8


def record(folder: Path, patterns: int | None) -> int:
    """Record until this many patterns were shown and then kill it, or until it ends; return its
    exit code.
    """
    command = [sys.executable, "-m", "tests.capture.screen.killed", str(folder), str(POSES)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        for shown, _ in enumerate(process.stdout, start=1):
            if shown == patterns:
                process.kill()
                break
        process.stdout.read()
    return process.returncode


@pytest.mark.slow
def test_twenty_kills_lose_no_pose(tmp_path: Path) -> None:
    folder = tmp_path / "session"
    rng = np.random.default_rng(4)
    kept: dict[str, bytes] = {}
    for _ in range(KILLS):
        record(folder, int(rng.integers(1, 60)))
        poses = {path.name: path.read_bytes() for path in (folder / "points").glob("*.npz")}
        assert kept.items() <= poses.items()
        kept = poses
        if kept:
            assert len(read_session(folder).points) == len(kept)
    with PointsSession(folder) as session:
        assert len(session.pixels) == len(kept)
    assert len(kept) > 0
    assert record(folder, None) == 0
    assert len(read_session(folder).points) == max(POSES, len(kept))
    assert not list(folder.rglob("*.tmp"))
