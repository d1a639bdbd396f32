"""The figures by matplotlib: functions that take Axes, and the pictures of `calib report --png`."""

import subprocess
import sys
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver

from calib import plots
from calib.calibration import Calibration
from calib.cli import main
from calib.fit_record.request import Settings
from calib.plots.figures import FIGURES
from calib.plots.space import board_outlines
from calib.plots.style import INK, label_lines, side_by_side
from calib.report.evidence import gather_evidence
from calib.report.patterns import over_image
from fixtures.synthetic import scene
from tests.report.made import calibrated

SETTINGS = Settings(grid=(5, 5), free=("none",))


@pytest.fixture(scope="module")
def calibration(tmp_path_factory: pytest.TempPathFactory) -> Calibration:
    made = scene(7, views=6, amplitude=1e-5, noise=0.05)
    return calibrated(made, tmp_path_factory.mktemp("fit"), SETTINGS)


def test_residuals_and_distortion_draw_into_given_axes(calibration: Calibration) -> None:
    """The arrows are the means of the cells; the title has the range of the field."""
    figure = Figure()
    left, right = figure.subplots(1, 2)
    plots.residuals(calibration, left)
    plots.distortion(calibration, 0.5, right)
    means = over_image(gather_evidence(calibration))
    drawn = [item for item in left.collections if isinstance(item, Quiver)]
    lengths = np.concatenate([np.hypot(item.U, item.V) for item in drawn])
    assert len(lengths) == means.judged
    assert lengths.max() == pytest.approx(np.nanmax(means.length))
    assert right.get_title().startswith("at 0.5 m: ")
    for axes in (left, right):
        assert axes.get_xlim() == (-0.5, calibration.camera.width - 0.5)
        assert axes.get_ylim() == (calibration.camera.height - 0.5, -0.5)


def test_the_scene_holds_every_board(calibration: Calibration) -> None:
    """The middle of each outline is the translation of its pose: the board's centre."""
    figure = plots.scene(calibration)
    assert len(figure.axes) == 2, "the scene and its colour bar"
    outlines = board_outlines(gather_evidence(calibration))
    assert outlines.mean(1) == pytest.approx(calibration.poses[:, 3:], abs=1e-12)


@pytest.mark.slow
def test_the_command_writes_pictures_and_no_report(
    calibration: Calibration, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    calibration.save(tmp_path)
    folder = tmp_path / "figures"
    assert main(["report", str(tmp_path), "--png", str(folder), "--depth", "0.4"]) == 0
    drawn = [name for name in FIGURES if name != "glass-detail.png"]  # too few points for it
    assert capfd.readouterr().out.splitlines() == [str(folder / name) for name in drawn]
    for name in drawn:
        picture = cv2.imread(str(folder / name))
        assert picture is not None
        assert picture.shape[1] > 1000, name
        assert picture.std() > 5, "not empty"
    assert not (tmp_path / "report.html").exists()


def test_without_matplotlib_the_command_says_how_to_install_it(
    calibration: Calibration, tmp_path: Path
) -> None:
    """In a fresh interpreter, for in this one it is loaded. The report needs none."""
    calibration.save(tmp_path)
    code = (
        "import sys; sys.modules['matplotlib'] = None\nfrom calib.cli import main\n"
        f"print(main(['report', {str(tmp_path)!r}, '--no-open']))\n"
        f"print(main(['report', {str(tmp_path)!r}, '--png', 'x']))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines() == [str(tmp_path / "report.html"), "0", "2"]
    assert "need matplotlib: " in done.stderr
    assert "-m pip install 'matplotlib>=3.8'" in done.stderr


def test_the_levels_of_contours_keep_clear_of_the_border_and_of_each_other() -> None:
    """Contours that crowd at the border and cut off its corners, as the maps' predicted errors
    do.
    """
    figure = Figure((4.0, 3.0))
    (axes,) = side_by_side(figure, [3.0], [0.6])
    x, y = np.meshgrid(np.linspace(-1, 1, 65), np.linspace(-1, 1, 49))
    lines = axes.contour(x, y, x**8 + y**8 + 0.2 * x**2, [0.05, 0.5, 0.9, 1.9], colors=[INK])
    label_lines(axes, lines, marks=np.array([[0.0, 0.5]]))
    figure.draw_without_rendering()
    boxes = [text.get_window_extent() for text in axes.texts]
    assert {text.get_text() for text in axes.texts} >= {"0.05", "0.5"}
    assert all(
        axes.bbox.x0 < b.x0 and b.x1 < axes.bbox.x1 and axes.bbox.y0 < b.y0 and b.y1 < axes.bbox.y1
        for b in boxes
    )
    assert not any(first.overlaps(second) for first, second in combinations(boxes, 2))
    assert not any(box.contains(*axes.transData.transform((0.0, 0.5))) for box in boxes)
