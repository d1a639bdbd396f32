"""The library in a notebook: what it shows, its calls with arrays and paths, and the notebook of
docs/, run as it stands there.
"""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import calib
from calib.calibration import Calibration
from calib.corners.view import View
from calib.diagnosis.finding import Diagnosis
from calib.errors import InputError, RefracalError, WrongTypeError
from calib.fit_record.history import Quality
from calib.session.cover_section import cover_to_yaml
from calib.verdict.verdict import Reason, Verdict
from fixtures.known import known, lens_alone
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, Scene, bare_views, scene
from tests.test_calibration import write_session

ROOT = Path(__file__).parents[1]
NOTEBOOK = ROOT / "docs" / "notebook.ipynb"
EVEN = calib.Settings(grid=(1, 1))
SIZE = (WIDTH, HEIGHT)
Points = tuple[list[np.ndarray], list[np.ndarray]]


@pytest.fixture(scope="module")
def made() -> Scene:
    """Ten views through a perfect cone."""
    return scene(4, views=10, noise=0.05, amplitude=0.0)


@pytest.fixture(scope="module")
def session(made: Scene, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_session(tmp_path_factory.mktemp("notebook"), made)


@pytest.fixture(scope="module")
def fitted(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the session's calibration."""
    folder = tmp_path_factory.mktemp("fitted")
    calib.fit(session, EVEN).save(folder)
    return folder


def arrays_of(made: Scene, views: tuple[View, ...]) -> Points:
    """Return object_points and image_points of the seen corners, as OpenCV's examples have them:
    float32, the origin in a corner of the board.
    """
    points = np.column_stack([made.board.points(), np.zeros(made.board.count)])
    points -= points.min(0)
    objects = [points[view.seen].astype(np.float32) for view in views]
    pixels = [view.corners[view.seen].astype(np.float32).reshape(-1, 1, 2) for view in views]
    return objects, pixels


def camera_matrix() -> np.ndarray:
    k = INTRINSICS
    return np.array([[k.fx.value, 0, k.cx.value], [0, k.fy.value, k.cy.value], [0, 0, 1]])


def test_a_calibration_is_one_line_and_a_table(fitted: Path) -> None:
    calibration = Calibration.load(fitted)
    line = repr(calibration)
    assert "\n" not in line
    assert len(line) < 200
    assert f"{WIDTH}x{HEIGHT} px" in line
    assert "a cone" in line
    assert "10 views" in line
    html = calibration._repr_html_()
    assert html == calib.describe(fitted)._repr_html_()
    assert "cover.thickness" in html
    assert "<script" not in html


def test_a_session_is_one_line_and_a_table(session: Path) -> None:
    read = calib.read_session(session)
    assert "\n" not in repr(read)
    assert "a cone" in repr(read)
    assert len(repr(replace(read, corners=None, frames=(Path("a.png"),) * 500))) < 300
    html = read._repr_html_()
    assert "<td><div>cover.inner_radius</div></td>" in html
    assert "41.95" in html


def test_a_verdict_and_a_diagnosis_are_shown() -> None:
    verdict = Verdict((Reason("the <glass> is thick.", "calib fit 'a & b'"),), "calib export")
    html = verdict._repr_html_()
    assert "<li>The &lt;glass&gt; is thick.</li>" in html
    assert "<code>calib fit &#x27;a &amp; b&#x27;</code>" in html
    before, after = Quality(0.5, 0.1, 0.6), Quality(0.2, 0.05, 0.25)
    finding = Diagnosis(0.1, "", (), (), (), before, after, 0.0, "", ("Nothing < is left.",))
    html = finding._repr_html_()
    assert "0.600 px" in html
    assert "0.250 px" in html
    assert "Nothing &lt; is left." in html


def test_names_of_a_calibration(fitted: Path) -> None:
    calibration = Calibration.load(fitted)
    intrinsics = calibration.camera.intrinsics
    assert intrinsics
    assert calibration.K[0, 0] == intrinsics.fx.value
    assert calibration.K[1, 2] == intrinsics.cy.value
    assert np.array_equal(calibration.K, calib.Undistorter(calibration, 0.5).camera_matrix)
    lens = lens_alone(scene(1, views=1), 640, 480, 500, 501, 320, 240, -0.2, 0.1, 0.0, 0.0)
    assert lens.distortion.tolist() == [-0.2, 0.1, 0.0, 0.0]
    assert calibration.verdict.sentences == calib.judge(calibration).sentences
    assert calib.__version__ == calib.version.VERSION


def test_paths_are_taken_for_sessions_and_calibrations(session: Path, fitted: Path) -> None:
    calibration = Calibration.load(fitted)
    read = calib.read_session(session)
    again = calib.fit(str(session), EVEN)
    assert again.stages == calibration.stages
    assert calib.evaluate(str(fitted), session) == calib.evaluate(calibration, read)
    assert calib.judge(fitted).sentences == calibration.verdict.sentences
    assert calib.Measurer(fitted).noise_px == calib.Measurer(calibration).noise_px
    assert calib.TagLocator(fitted, "DICT_APRILTAG_36h11", 0.05).calibration.K[0, 0] > 0


def test_an_undistorter_takes_the_depth_of_the_corners(fitted: Path) -> None:
    undistorter = calib.Undistorter(str(fitted))
    depth = undistorter.depth
    assert isinstance(depth, float)
    poses = Calibration.load(fitted).poses
    assert poses[:, 5].min() < depth < poses[:, 5].max()
    with pytest.raises(InputError, match="give depth, in m"):
        calib.Undistorter(known(scene(1, views=1), 164, 123))


WRONG: dict[str, Callable[[Path], object]] = {
    "session is of type int: pass a session": lambda _: calib.fit(5),  # type: ignore[arg-type]
    "settings is of type dict: pass a calib.Settings": lambda path: calib.fit(path, {}),  # type: ignore[arg-type]
    "progress is of type str: pass a calib.Progress": lambda path: calib.diagnose(path, "HOLDOUT"),  # type: ignore[arg-type]
    "session is of type ndarray": lambda path: calib.evaluate(path, np.zeros(3)),  # type: ignore[arg-type]
    "calibration is of type NoneType": lambda _: calib.Undistorter(None),  # type: ignore[arg-type]
    "calibration is of type list": lambda _: calib.judge([]),  # type: ignore[arg-type]
    "calibration is of type float": lambda _: calib.describe(1.0),  # type: ignore[arg-type]
    "calibration is of type tuple": lambda _: calib.Measurer(()),  # type: ignore[arg-type]
    "path is of type int": lambda _: calib.read_session(3),  # type: ignore[arg-type]
    "path is of type dict": lambda _: Calibration.load({}),  # type: ignore[arg-type]
    "depth is 'far': give a real number": lambda path: calib.Undistorter(path, "far"),  # type: ignore[arg-type]
    "pixels is not an array of real numbers": lambda path: Calibration.load(path).rays("a"),  # type: ignore[arg-type]
    "object_points is of type int": lambda _: calib.calibrate(1, [], SIZE),  # type: ignore[arg-type]
    "size is of type int: pass": lambda _: calib.calibrate([], [], 640),  # type: ignore[arg-type]
    "cover is of type int: pass a mapping": lambda _: calib.calibrate([], [], SIZE, cover=3),  # type: ignore[arg-type]
}


@pytest.mark.parametrize("message", WRONG)
def test_a_wrong_type_is_a_type_error_that_says_what_to_pass(message: str, fitted: Path) -> None:
    with pytest.raises(TypeError, match=message) as raised:
        WRONG[message](fitted)
    assert isinstance(raised.value, WrongTypeError)
    assert isinstance(raised.value, RefracalError)


@pytest.mark.slow
def test_arrays_without_a_cover_give_the_camera_that_opencv_gives() -> None:
    made = scene(2, views=1)
    views = tuple(bare_views(2, views=14, noise=0.05))
    objects, pixels = arrays_of(made, views)
    calibration = calib.calibrate(objects, pixels, SIZE)
    _, matrix, *_ = cv2.calibrateCamera(objects, pixels, SIZE, None, None)
    assert pytest.approx(matrix, rel=0.01, abs=1e-9) == calibration.K
    assert calibration.request.session == "SESSION"


def test_arrays_with_a_cover_give_what_the_session_gives(
    made: Scene, fitted: Path, tmp_path: Path
) -> None:
    views = Calibration.load(fitted).views
    objects, pixels = arrays_of(made, views)
    calibration = calib.calibrate(
        objects, pixels, SIZE, camera_matrix(), cover=made.cover, settings=EVEN
    )
    same = calib.calibrate(
        objects,
        pixels,
        SIZE,
        camera_matrix(),
        cover=cover_to_yaml(made.cover),  # type: ignore[arg-type]
        settings=EVEN,
    )
    assert same.stages == calibration.stages
    expected = Calibration.load(fitted)
    assert calibration.stages[-1].rms_px == pytest.approx(expected.stages[-1].rms_px, rel=1e-3)
    assert pytest.approx(expected.K, rel=1e-4, abs=1e-9) == calibration.K
    reloaded = Calibration.load(calibration.save(tmp_path))
    assert reloaded.verdict.sentences == calibration.verdict.sentences


def test_a_view_may_show_a_part_of_the_board(made: Scene, fitted: Path) -> None:
    objects, pixels = arrays_of(made, Calibration.load(fitted).views)
    objects[0], pixels[0] = objects[0][9:][::-1], pixels[0][9:][::-1]
    pixels[1] = pixels[1].copy()
    pixels[1][5] = np.nan
    calibration = calib.calibrate(
        objects, pixels, SIZE, camera_matrix(), cover=made.cover, settings=EVEN
    )
    counts = [view.count for view in calibration.views]
    assert sorted(counts)[:2] == [72, 80]
    assert calibration.stages[-1].rms_px < 0.1


DOME: dict[str, object] = {
    "shape": "dome",
    "inner_radius_mm": 50,
    "centre_mm": [0, 0, 0],
    "thickness_mm": 3,
    "refractive_index": 1.49,
}

REFUSED: dict[str, Callable[[Points], object]] = {
    "has 9 views and image_points 10": lambda points: calib.calibrate(
        points[0][1:], points[1], SIZE
    ),
    "view 0 has 80 object_points and 81 image_points": lambda points: calib.calibrate(
        [points[0][0][1:], *points[0][1:]], points[1], SIZE
    ),
    "are no grid of squares": lambda points: calib.calibrate(
        [array**1.3 for array in points[0]], points[1], SIZE
    ),
    "are on a plane, and not on z = 0": lambda points: calib.calibrate(
        [array + np.array([0, 0, 0.1]) for array in points[0]], points[1], SIZE
    ),
    "outside 64x48 px: give size": lambda points: calib.calibrate(*points, (64, 48)),
    "camera_matrix is missing: calibrate the camera without": lambda points: calib.calibrate(
        *points, SIZE, cover=DOME
    ),
    "are 20 m apart: give metres": lambda points: calib.calibrate(
        [1000 * array for array in points[0]], points[1], SIZE, camera_matrix(), cover=DOME
    ),
    "distortion is given without": lambda points: calib.calibrate(
        *points, SIZE, distortion=[0, 0, 0, 0]
    ),
    "twice: give each point once": lambda points: calib.calibrate(
        [array[[0, *range(80)]] for array in points[0]], points[1], SIZE
    ),
    "holds no point": lambda _: calib.calibrate([], [], SIZE),
}


@pytest.mark.parametrize("message", REFUSED)
def test_arrays_that_do_not_fit_are_refused(message: str, made: Scene, fitted: Path) -> None:
    points = arrays_of(made, Calibration.load(fitted).views)
    with pytest.raises(InputError, match=message):
        REFUSED[message](points)


@pytest.mark.slow
def test_the_notebook_runs(tmp_path: Path) -> None:
    """Its cells run one after the other in the folder docs/, as Jupyter runs them; what the last
    line of a cell shows is made as well.
    """
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    assert not any(cell.get("outputs") for cell in cells)
    sources = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
    assert len(sources) > 5
    (tmp_path / "docs").mkdir()
    shutil.copytree(
        ROOT / "fixtures" / "wet-dome",
        tmp_path / "fixtures" / "wet-dome",
        ignore=shutil.ignore_patterns(".detections.json"),
    )
    environment = {"PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg", "TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", RUN_CELLS],
        input=json.dumps(sources),
        cwd=tmp_path / "docs",
        env=os.environ | environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "cover.inner_radius" in done.stdout
    assert "You can trust this calibration" in done.stdout


RUN_CELLS = """
import ast, json, sys
names = {}
for source in json.load(sys.stdin):
    tree = ast.parse(source)
    last = ast.Expression(tree.body.pop().value)
    exec(compile(tree, "cell", "exec"), names)
    shown = eval(compile(last, "cell", "eval"), names)
    print(shown._repr_html_() if hasattr(shown, "_repr_html_") else repr(shown))
"""
"""Runs the cells whose texts stdin has, and prints what the last line of each shows."""
