"""Every command takes a calibration of a lens of any field of view, even beyond 180 degrees, or
says in one sentence why not.
"""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from calib.calibration import Calibration
from calib.cli import main
from fixtures.wide import BOARD, AngleLens

DEGREES = (60, 100, 140, 180, 200, 220)
MODELS = ("fisheye", "auto", "splined")
QUICK = (220, "fisheye")
QUICK_ID = "220-fisheye"
"""The other lenses take half a minute each."""
VIEWS, HELD_OUT = 14, 6
FORMATS = (
    *("npz", "opencv", "opencv-xml", "ros", "kalibr", "colmap", "mrcal"),
    *("windshield", "depthai", "generic", "calibmar", "ray-image", "stmap"),
    *("nerfstudio", "photonvision", "mitsuba", "blender", "gsplat"),
)
QUICK_FORMATS = ("npz", "generic", "calibmar")
ALLOWED_CODES = {0, 2, 3}
"""Success; wrong input; not enough good data. 1 is a bug."""
REFUSED_WORDS = {"immerse", "calibmar", "pose"}
"""Words of the commands that refuse: no calibration has a cover, and no picture shows a tag."""
DEPTH = 0.4
"""m"""
MAX_ERROR_PX = 3.0
"""The largest error of nearly all pixels of a map, between the few corners of these sessions."""
MAX_ERROR_DEGREES = 0.3
"""The largest error of a ray."""

each_lens = pytest.mark.parametrize(
    "fitted",
    [
        pytest.param(
            (degrees, model),
            id=f"{degrees}-{model}",
            marks=[] if (degrees, model) == QUICK else pytest.mark.slow,
        )
        for degrees in DEGREES
        for model in MODELS
    ],
    indirect=True,
)


@pytest.fixture(scope="module")
def fitted(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with session, held-out, picture.png and the calibration."""
    degrees, model = request.param
    lens = AngleLens(degrees)
    folder = tmp_path_factory.mktemp(f"{model}-{degrees}")
    session = lens.write_session(folder / "session", lens.views(1, VIEWS), model)
    lens.write_session(folder / "held-out", lens.views(2, HELD_OUT), model)
    assert (
        main(["fit", str(session), "--depth", str(DEPTH), "-o", str(folder / "calibration")]) == 0
    )
    picture = np.full((lens.camera.height, lens.camera.width), 200, np.uint8)
    assert cv2.imwrite(str(folder / "picture.png"), picture)
    return folder


def run(words: list[str], capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    """Return the exit code and stdout, after checks of the code and of a refusal's sentence."""
    capsys.readouterr()
    try:
        code = main(words)
    except SystemExit as stopped:  # argparse
        code = int(stopped.code or 0)
    out, err = capsys.readouterr()
    assert code in ALLOWED_CODES, (words, err)
    if code:
        sentence = err.strip().splitlines()[-1]
        assert sentence.startswith("calib: error: "), (words, err)
        assert sentence.endswith("."), (words, err)
    assert "Warning" not in err, (words, err)
    return code, out


@pytest.mark.slow
@each_lens
def test_every_command_takes_the_calibration(
    fitted: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    request: pytest.FixtureRequest,
) -> None:
    folder = str(fitted / "calibration")
    picture = str(fitted / "picture.png")
    held_out = str(fitted / "held-out")
    points = tmp_path / "points.csv"
    points.write_text("name,image,x,y\na,picture.png,320,240\nb,picture.png,8,237\n")
    poses = tmp_path / "poses.csv"
    poses.write_text("image,rx,ry,rz,tx,ty,tz\npicture.png,0,0,0,0,0,-0.3\n")
    commands = [
        ["report", "--no-open", folder],
        ["evaluate", folder, held_out],
        ["check", folder, held_out],
        ["check", folder, held_out, "--update", "-o", str(tmp_path / "updated")],
        ["diagnose", folder, "-o", str(tmp_path / "diagnosed")],
        ["immerse", folder, "--outside-index", "1.33", "-o", str(tmp_path / "wet")],
        ["undistort", folder, picture, "--depth", "0.5", "-o", str(tmp_path / "straight")],
        ["undistort", folder, picture, "--depth", "1", "--crop", "1", "-o", str(tmp_path / "all")],
        ["measure", folder, str(points), "--depth", "0.5"],
        ["pose", folder, picture, "--tags", "DICT_4X4_50", "--size-mm", "20"],
        *(
            ["export", folder, "--format", form, "--depth", "1", "-o", str(tmp_path / form)]
            for form in (QUICK_FORMATS if request.node.callspec.id == QUICK_ID else FORMATS)
        ),
    ]
    for words in commands:
        code, _ = run(words, capsys)
        assert (code != 0) == bool(REFUSED_WORDS & set(words)), words
    on_boards = ["measure", folder, str(points), "--on-boards", "--poses", str(poses)]
    assert run(on_boards, capsys)[0] in {0, 3}, "3 where no point lies on a board"
    assert (fitted / "calibration" / "report.html").exists()
    assert (tmp_path / "diagnosed" / "report.html").exists()


@each_lens
def test_the_bands_of_an_evaluation_sum_up(
    fitted: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, out = run(
        ["evaluate", str(fitted / "calibration"), str(fitted / "held-out"), "--json"], capsys
    )
    assert code == 0
    evaluation = json.loads(out)
    bands = evaluation["by_depth"]
    assert sum(band["corners"] for band in bands) == HELD_OUT * BOARD.count
    assert all(0 <= band["from_m"] < band["to_m"] for band in bands)
    assert 0 < evaluation["near_m"] < evaluation["far_m"]
    assert bands[0]["from_m"] <= evaluation["near_m"] < bands[0]["to_m"]
    assert bands[-1]["from_m"] <= evaluation["far_m"] < bands[-1]["to_m"]
    squares = sum(band["corners"] * band["rms_px"] ** 2 for band in bands)
    assert (squares / HELD_OUT / BOARD.count) ** 0.5 == pytest.approx(
        evaluation["rms_px"], rel=1e-9
    )
    assert evaluation["rms_px"] < 0.1, "the noise is 0.05 px along x and along y"


@each_lens
def test_maps_show_what_a_pinhole_can(
    fitted: Path, request: pytest.FixtureRequest, capsys: pytest.CaptureFixture[str]
) -> None:
    """A valid pixel is where the lens images its direction, less than 90 degrees from the axis. The
    others are -1, and black in an undistorted picture.
    """
    lens = AngleLens(request.node.callspec.params["fitted"][0])
    arrays = np.load(fitted / "calibration" / f"map_{DEPTH}m.npz")
    x = arrays["map_x"]
    y = arrays["map_y"]
    valid = arrays["valid"]
    assert valid.any()
    assert (x[~valid] == -1).all()
    assert (y[~valid] == -1).all()
    k = Calibration.load(fitted / "calibration").camera.intrinsics
    assert k
    columns, rows = np.meshgrid(np.arange(lens.camera.width), np.arange(lens.camera.height))
    slopes = np.stack([(columns - k.cx.value) / k.fx.value, (rows - k.cy.value) / k.fy.value], -1)
    directions = np.concatenate([slopes, np.ones_like(slopes[..., :1])], -1)
    truth = lens.project(directions.reshape(-1, 3)).reshape(slopes.shape)
    error = np.hypot(x - truth[..., 0], y - truth[..., 1])
    assert np.nanquantile(error[valid], 0.95) < MAX_ERROR_PX
    assert valid[np.isfinite(truth).all(-1)].mean() > 0.99
    written = fitted / "undistorted"
    picture = str(fitted / "picture.png")
    words = ["undistort", str(fitted / "calibration"), picture, "--depth", str(DEPTH)]
    assert run([*words, "-o", str(written)], capsys)[0] == 0
    straight = cv2.imread(str(written / "picture.png"), cv2.IMREAD_GRAYSCALE)
    assert straight is not None
    assert np.array_equal(straight == 0, ~valid)


@each_lens
def test_rays_go_where_the_lens_sees(fitted: Path, request: pytest.FixtureRequest) -> None:
    """Rays agree from the axis to the border of the field, even behind the camera, and project
    back.
    """
    lens = AngleLens(request.node.callspec.params["fitted"][0])
    calibration = Calibration.load(fitted / "calibration")
    angles, azimuths = np.meshgrid(np.linspace(0.05, 0.97, 12) * lens.half, np.arange(0, 6.2, 0.4))
    directions = np.stack(
        [
            np.sin(angles) * np.cos(azimuths),
            np.sin(angles) * np.sin(azimuths),
            np.cos(angles),
        ],
        -1,
    ).reshape(-1, 3)
    pixels = lens.project(directions)
    visible = np.isfinite(pixels).all(-1)
    _, rays = calibration.rays(pixels[visible])
    error = np.degrees(np.arccos(np.clip((rays * directions[visible]).sum(-1), -1, 1)))
    assert error.max() < MAX_ERROR_DEGREES
    assert np.abs(calibration.project(rays) - pixels[visible]).max() < 1e-6


@pytest.mark.slow
def test_a_lens_that_is_not_wide_gets_an_answer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """OpenCV's formula cannot follow 220 degrees, and puts corners behind the camera. A diagnosis
    says so, and writes its report.
    """
    lens = AngleLens(220)
    session = str(lens.write_session(tmp_path / "session", lens.views(1, VIEWS), "opencv"))
    estimate, better = str(tmp_path / "calibration"), str(tmp_path / "diagnosed")
    assert run(["fit", session, "-o", estimate], capsys)[0] == 0
    code, out = run(["diagnose", estimate, "-o", better, "--json"], capsys)
    assert code == 0
    assert json.loads(out)["verdict"]["word"] != "trusted"
    assert (tmp_path / "diagnosed" / "report.html").exists()
    for calibration in (estimate, better):
        run(["evaluate", calibration, session], capsys)
        run(["export", calibration, "--format", "npz", "-o", str(tmp_path / "maps")], capsys)


@pytest.mark.slow
@pytest.mark.parametrize("fitted", [QUICK], indirect=True)
def test_commands_say_where_undistorted_pictures_end(
    fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = str(fitted / "calibration")
    picture = str(fitted / "picture.png")
    for words in (
        ["undistort", folder, picture, "--depth", "0.5", "-o", str(tmp_path / "straight")],
        ["export", folder, "--format", "npz", "-o", str(tmp_path / "maps")],
        ["export", folder, "--format", "stmap", "--depth", "1", "-o", str(tmp_path / "stmap")],
    ):
        capsys.readouterr()
        assert main(words) == 0
        assert "ends before 90 degrees" in capsys.readouterr().err
    assert (
        main(["export", folder, "--format", "ros", "--depth", "1", "-o", str(tmp_path / "ros")])
        == 0
    )
    text = (tmp_path / "ros" / "camera_info_1m.yaml").read_text()
    assert "It holds up to 87 degrees from the axis" in text
    assert "It holds up to 87 degrees from the axis" in capsys.readouterr().err


@pytest.mark.parametrize("fitted", [QUICK], indirect=True)
def test_the_report_has_no_depth_behind_the_camera(fitted: Path) -> None:
    """The report shows distances, and says where undistorted pictures end."""
    text = (fitted / "calibration" / "report.html").read_text()
    assert "m away" in text
    assert "-0." not in text.split("m away")[0].split("corners), ")[-1]
    assert "ends before 90 degrees" in " ".join(text.split())
