"""STMaps as a compositing program reads them: red and green times the picture's size, from its
bottom left corner, name the source.
"""

import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.calibration import Calibration
from calib.cli import main
from calib.extras import how_to_install

DEPTH = 0.4
WIDTH, HEIGHT = 820, 616
FORMATS = pytest.mark.parametrize("form", ["stmap", "stmap-exr"])


@pytest.fixture(scope="module")
def maps(small: Calibration, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with both forms."""
    folder = tmp_path_factory.mktemp("stmap")
    small.save(folder)
    forms = ["stmap"]
    try:
        import OpenEXR  # noqa: F401
    except ImportError:
        pass
    else:
        forms.append("stmap-exr")
    for form in forms:
        assert (
            main(
                ["export", str(folder), "--format", form, "--depth", str(DEPTH), "-o", str(folder)]
            )
            == 0
        )
    return folder


def read(folder: Path, direction: str, form: str) -> np.ndarray:
    """(h, w, 4) red, green, blue, alpha."""
    path = folder / f"stmap_{direction}_0.4m.{'exr' if form == 'stmap-exr' else 'tiff'}"
    if form == "stmap":
        stored = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert stored is not None
        return cv2.cvtColor(stored, cv2.COLOR_BGRA2RGBA)
    openexr = pytest.importorskip(
        "OpenEXR",
        reason="OpenEXR is not installed (pip install -e '.[exr]'): its file was not read",
    )
    with openexr.File(str(path)) as file:
        return np.asarray(file.channels()["RGBA"].pixels)


def sources(stored: np.ndarray, at: np.ndarray) -> np.ndarray:
    """(N, 2) px, counted as we do, that a map names for (N, 2) px."""
    red, green = stored[at[:, 1], at[:, 0], :2].astype(np.float64).T
    return np.column_stack([red * WIDTH - 0.5, (1 - green) * HEIGHT - 0.5])


@FORMATS
def test_undistort_and_redistort_are_the_rays(small: Calibration, maps: Path, form: str) -> None:
    at = np.random.default_rng(3).integers([40, 40], [WIDTH - 40, HEIGHT - 40], (500, 2))
    k = small.camera.intrinsics
    assert k
    focal, principal = np.array([k.fx.value, k.fy.value]), np.array([k.cx.value, k.cy.value])
    undistort = read(maps, "undistort", form)
    redistort = read(maps, "redistort", form)
    for stored in (undistort, redistort):
        assert stored.shape == (HEIGHT, WIDTH, 4)
        assert stored.dtype == np.float32
    straight = np.column_stack([(at - principal) / focal, np.ones(500)]) * DEPTH
    assert np.abs(sources(undistort, at) - small.project(straight)).max() < 0.01
    origins, directions = small.rays(at.astype(np.float64))
    met = origins + ((DEPTH - origins[:, 2]) / directions[:, 2])[:, None] * directions
    assert np.abs(sources(redistort, at) - (met[:, :2] / DEPTH * focal + principal)).max() < 0.01


@FORMATS
def test_alpha_is_1_inside_the_camera_s_view_and_all_is_0_outside(
    small: Calibration, maps: Path, form: str
) -> None:
    stored = read(maps, "undistort", form)
    valid = small.ray_field().map_at(DEPTH).valid
    assert 0 < np.count_nonzero(~valid) < valid.size
    assert np.array_equal(stored[..., 3], valid)
    assert not stored[~valid].any()
    assert not stored[..., 2].any()


def test_without_openexr_a_sentence_says_how_to_get_it_before_anything_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    assert (
        main(
            [
                "export",
                str(tmp_path / "missing"),
                "--format",
                "stmap-exr",
                "--depth",
                "1",
                "-o",
                str(tmp_path),
            ]
        )
        == 2
    )
    stderr = capsys.readouterr().err
    assert f"{how_to_install('exr')}, or use --format stmap" in stderr
