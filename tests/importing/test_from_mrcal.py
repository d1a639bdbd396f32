"""A .cameramodel that mrcal itself fitted and wrote."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from calib.cli import main
from calib.corners.corners_file import read_corners, write_corners
from calib.corners.view import View
from calib.session.session import read_session
from tests.importing.recordings import BOARD, MATRIX, SIZE, corners

COMMAND = "mrcal-calibrate-cameras"


@pytest.mark.skipif(
    shutil.which(COMMAND) is None,
    reason="mrcal is not installed (apt-get install mrcal): no file of its own was imported",
)
def test_mrcal_s_calibration_is_imported(tmp_path: Path) -> None:
    """The import keeps mrcal's corners, in its order, with those that it rejected as outliers
    marked as not seen.
    """
    all_corners = corners(12).reshape(12, BOARD.count, 2) + np.random.default_rng(1).normal(
        0, 0.1, (12, BOARD.count, 2)
    )
    all_corners[4, 20] += 15  # an outlier
    weight = np.ones(BOARD.count)
    weight[5] = 0.25
    write_corners(
        tmp_path / "corners.vnl",
        [
            View(f"view{i:02d}.png", view_corners, weight)
            for i, view_corners in enumerate(all_corners)
        ],
    )
    options = {
        "--corners-cache": str(tmp_path / "corners.vnl"),
        "--lensmodel": "LENSMODEL_OPENCV5",
        "--focal": "500",
        "--object-spacing": str(BOARD.square),
        "--object-width-n": str(BOARD.columns),
        "--object-height-n": str(BOARD.rows),
        "--outdir": str(tmp_path),
    }
    words = [word for option in options.items() for word in option]
    subprocess.run(
        [COMMAND, *words, "--imagersize", *map(str, SIZE), "view*.png"],
        check=True,
        capture_output=True,
        cwd=tmp_path,
    )
    assert (
        main(["import", "mrcal", str(tmp_path / "camera-0.cameramodel"), "-o", str(tmp_path / "s")])
        == 0
    )
    session = read_session(tmp_path / "s")
    assert session.board == BOARD
    assert (session.camera.width, session.camera.height) == SIZE
    assert session.corners
    views = read_corners(session.corners, BOARD)
    assert [view.name for view in views] == [f"view{i:02d}.png" for i in range(12)]
    for view, expected in zip(views, all_corners, strict=True):
        assert np.nanmax(np.abs(view.corners - expected)) < 1e-9
        assert view.weight[5] in (0.25, 0.0)
    assert views[4].weight[20] == 0
    assert sum(view.count for view in views) > 12 * BOARD.count - 10
    remark = next(
        line
        for line in (session.path / "session.yaml").read_text().splitlines()
        if "mrcal's own" in line
    )
    focal = float(remark.partition("fx: ")[2].partition(",")[0])
    assert focal == pytest.approx(MATRIX[0, 0], abs=3)
