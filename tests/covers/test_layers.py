"""A window of laminated glass, from session.yaml to the exports."""

from pathlib import Path

import numpy as np
import pytest
from textual.widgets import Input

from calib.apply.change_medium import immerse
from calib.calibration import Calibration
from calib.cli import main
from calib.errors import InputError
from calib.fit_record.request import Settings
from calib.fitting.declared import comparisons
from calib.fitting.fit import fit
from calib.fleet.limits import limit_of
from calib.progress import Silent
from calib.session.cover import Cover
from calib.session.cover_section import cover_to_yaml, read_cover
from calib.session.freeing import ALL, free_parameters
from calib.session.schema import Number, Section
from calib.session.session import read_session
from calib.verdict.judge import judge
from capture.session_file import read_setup
from capture.tui.form import find_problem, read_form, write_form
from tests.capture.tui.driving import burst, drive, running, see
from tests.covers.oracle import CENTRE, FOCAL, Array, trace, views, write_session
from tests.report.made import report_in

WATER = 1.333
DISTANCE = 0.03
LAYERS = ((0.003, 1.52), (0.00076, 1.48), (0.004, 1.58))
"""m and index, from the inside out."""
COVER = {
    "shape": "flat",
    "distance_mm": {"value": 31.0, "sigma": 2.0},
    "layers": [
        {"thickness_mm": 3.0, "refractive_index": 1.52},
        {"thickness_mm": {"value": 0.76, "sigma": 0.05}, "refractive_index": 1.48},
        {"thickness_mm": 4.2, "refractive_index": {"value": 1.58, "exact": True}},
    ],
    "outside_index": WATER,
}
NAMES = (
    *("cover.distance", "cover.tilt.x", "cover.tilt.y"),
    *("cover.thickness", "cover.refractive_index"),
    *("cover.layer2.thickness", "cover.layer2.refractive_index"),
    *("cover.layer3.thickness", "cover.layer3.refractive_index", "cover.outside_index"),
)


def radius(sine: Array, depth: Array) -> Array:
    """Return the distance from the axis of a ray that has this sine at the pinhole.

    Snell's law has a closed form: the direction in water depends on water alone, and each layer
    adds a shift.
    """

    def tangent(index: float) -> Array:
        return np.asarray(sine / np.sqrt(index**2 - sine**2))

    glass = sum(thickness * tangent(index) for thickness, index in LAYERS)
    in_water = depth - DISTANCE - sum(thickness for thickness, _ in LAYERS)
    return np.asarray(DISTANCE * tangent(1.0) + glass + in_water * tangent(WATER))


def see_points(points: Array) -> Array:
    """Return the pixels of points, by bisection over the sine."""
    lateral = np.linalg.norm(points[:, :2], axis=-1)
    low, high = np.zeros(len(points)), np.full(len(points), 0.99)
    for _ in range(60):
        middle = (low + high) / 2
        is_inside = radius(middle, points[:, 2]) < lateral
        low, high = np.where(is_inside, middle, low), np.where(is_inside, high, middle)
    tangent = low / np.sqrt(1 - low**2)
    direction = points[:, :2] / lateral[:, None]
    return np.asarray(FOCAL * tangent[:, None] * direction + CENTRE)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_session(tmp_path_factory.mktemp("laminated"), COVER, views(see_points, 8, 5))


@pytest.fixture(scope="module")
def calibration(session: Path) -> Calibration:
    return fit(read_session(session), Settings(grid=(4, 4)), Silent())


def section(cover: object) -> Section:
    return Section({"cover": cover}, "session.yaml").section("cover", "")


def test_every_layer_has_its_numbers(session: Path) -> None:
    cover = read_session(session).cover
    assert tuple(cover.dimensions) == NAMES
    assert {*cover.numbers} == {*NAMES}
    assert cover.layers == 3
    assert cover.parameters["layer2.thickness"] == Number(0.00076, 0.00005)
    assert read_cover(section(cover_to_yaml(cover))) == cover
    assert cover_to_yaml(cover) == COVER | {
        "distance_mm": {"value": 31.0, "sigma": 2.0},
        "tilt_deg": [0.0, 0.0],
    }


def test_one_layer_is_written_as_before() -> None:
    single = {"shape": "flat", "distance_mm": 20.0, "layers": COVER["layers"][:1]}  # type: ignore[index]
    cover = read_cover(section(single))
    assert cover == read_cover(
        section(
            {"shape": "flat", "distance_mm": 20.0, "thickness_mm": 3.0, "refractive_index": 1.52}
        )
    )
    written = cover_to_yaml(cover)
    assert isinstance(written, dict)
    assert "layers" not in written


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"layers": []}, "cover.layers is a list of 0: write a list of up to 8 layers"),
        ({"layers": 3}, "cover.layers is 3: write a list of up to 8 layers from the inside out"),
        (
            {"layers": [{"thickness_mm": 0.01, "refractive_index": 1.5}]},
            r"cover.layers\[0\].thickness_mm is 0.01: write a number from 0.05",
        ),
        (
            {"layers": [{"thickness": 3, "refractive_index": 1.5}]},
            r"cover.layers\[0\].thickness is not a key of a layer \(did you mean thickness_mm\?\)",
        ),
        ({"thickness_mm": 3}, "cover.thickness_mm is not a key of the shape flat with layers"),
    ],
)
def test_layers_that_are_not_whole_are_refused(changed: dict[str, object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_cover(section(COVER | changed))


def test_no_cover_has_no_layers() -> None:
    with pytest.raises(InputError, match=r"cover\.layers is not a key of the shape none"):
        read_cover(section({"shape": "none", "layers": []}))


def test_the_ray_path_is_snells_closed_form(session: Path) -> None:
    truth = {"cover.distance": Number(DISTANCE), "cover.layer3.thickness": Number(0.004)}
    cover = read_session(session).cover.replace_numbers(truth)
    calibration_path = _calibration_of(session, cover)
    pixels = np.random.default_rng(0).uniform([0, 0], [1640, 1232], (50, 2))
    origins, directions = calibration_path.rays(pixels)
    depth = 0.5
    points = origins + (depth - origins[:, 2:]) / directions[:, 2:] * directions
    assert np.abs(see_points(points) - pixels).max() < 1e-8


def test_the_ray_path_is_that_of_a_tracer_by_bisection(session: Path) -> None:
    """A tilted window has no closed form about the axis."""
    tilt = np.radians(12.0)
    stack = Cover("flat", _tilted(session, tilt))
    normal = np.array([0.0, -np.sin(tilt), np.cos(tilt)])
    surfaces = []
    depth, index_before = 0.0, 1.0
    for thickness, index in (*LAYERS, (0.0, WATER)):
        surfaces.append(
            (lambda p, at=depth: (p - [0, 0, DISTANCE]) @ normal - at, index_before, index)
        )
        depth, index_before = depth + thickness, index
    pixels = np.random.default_rng(1).uniform([0, 0], [1640, 1232], (50, 2))
    origins, directions = trace(surfaces, pixels)
    ours = _calibration_of(session, stack).rays(pixels)
    assert np.abs(ours[0] - origins).max() < 1e-12
    assert np.abs(ours[1] - directions).max() < 1e-8  # numeric normals


def _tilted(session: Path, tilt: float) -> dict[str, Number]:
    cover = read_session(session).cover
    moved = {"distance": DISTANCE, "layer3.thickness": 0.004, "tilt.x": tilt}
    return {**cover.parameters, **{name: Number(value) for name, value in moved.items()}}


def _calibration_of(session: Path, cover: Cover) -> Calibration:
    read = read_session(session)
    return Calibration(
        board=read.board,
        camera=read.camera,
        cover=cover,
        relief=None,
        amplitudes=np.zeros((0, 0)),
        exact_hit=True,
        views=(),
        poses=np.zeros((0, 6)),
        covariance=np.zeros((0, 0)),
        rejected=(),
        stages=(),
        noise_px=0.1,
        gauge="",
    )


def test_a_fit_finds_where_it_stands(calibration: Calibration) -> None:
    errors_px = [stage.rms_px for stage in calibration.stages]
    pinhole, smooth, uneven = errors_px
    assert smooth < 0.1 * pinhole
    assert uneven < 0.02
    distance = calibration.cover.parameters["distance"]
    assert abs(distance.value - DISTANCE) < 4 * distance.sigma
    assert distance.sigma < 1e-3
    thickness = calibration.cover.numbers["cover.layer2.thickness"]
    assert abs(thickness.value - LAYERS[1][0]) < 4 * thickness.sigma
    rows = {row.name: row for row in comparisons(calibration)}
    assert rows["cover.layer3.thickness"].unit == "mm"
    assert rows["cover.layer3.refractive_index"].held


def test_every_layer_is_freed_with_its_tolerance(session: Path) -> None:
    read = read_session(session)
    assert read.camera.intrinsics
    _, cover = free_parameters(read.camera.intrinsics, read.cover, (ALL,))
    sigmas = {name: number.sigma for name, number in cover.numbers.items()}
    assert sigmas["cover.thickness"] == sigmas["cover.layer3.thickness"] == 5e-4
    assert sigmas["cover.layer2.refractive_index"] == 0.02
    assert sigmas["cover.layer3.refractive_index"] == 0  # exact
    _, partly = free_parameters(read.camera.intrinsics, read.cover, ("index",))
    assert {name for name, number in partly.numbers.items() if number.sigma} == {
        *("cover.refractive_index", "cover.layer2.refractive_index"),
        *("cover.layer3.refractive_index", "cover.distance", "cover.layer2.thickness"),
    }
    limit = limit_of("cover.layer2.thickness", {"max": 1.0}, "manifest")
    assert limit.name == "cover.layer2.thickness"


def test_it_is_saved_and_loaded(calibration: Calibration, tmp_path: Path) -> None:
    calibration.save(tmp_path)
    loaded = Calibration.load(tmp_path)
    assert [*loaded.cover.numbers] == [*calibration.cover.numbers]
    assert loaded.declared.cover == calibration.declared.cover
    pixels = np.array([[100.0, 200.0], [900.0, 600.0]])
    assert np.abs(loaded.rays(pixels)[0] - calibration.rays(pixels)[0]).max() < 1e-15


def test_the_report_and_the_verdict_know_its_layers(
    calibration: Calibration, tmp_path: Path
) -> None:
    page = report_in(tmp_path, calibration, (0.4,)).read_text(encoding="utf-8")
    assert "behind a flat window of 3 layers (" in page
    assert " and 1.58), in water (" in page
    assert "cover.layer2.thickness" in page
    assert judge(calibration).word


def test_it_goes_into_air(calibration: Calibration) -> None:
    dry = immerse(calibration, Number(1.0))
    assert dry.medium == Number(1.0)
    assert dry.calibration.cover.layers == 3
    assert np.isfinite(dry.after_px).all()
    assert np.isfinite(dry.other_face_px).all()


def test_it_is_exported_where_a_format_holds_it(
    calibration: Calibration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibration.save(tmp_path / "out")
    out = str(tmp_path / "out")
    folder = str(tmp_path / "opencv")
    assert main(["export", out, "--format", "opencv", "--depth", "0.4", "-o", folder]) == 0
    assert main(["export", out, "--format", "calibmar", "-o", str(tmp_path / "port")]) != 0
    assert "ports of one layer of glass" in capsys.readouterr().err


def test_a_check_and_a_diagnosis_take_it(
    session: Path, calibration: Calibration, tmp_path: Path
) -> None:
    calibration.save(tmp_path / "out")
    assert main(["check", str(tmp_path / "out"), str(session)]) == 0
    held = ("--free", "none", "--grid", "4x4", "-o", str(tmp_path / "held"))
    assert main(["fit", str(session), *held, "--effects", "thickness"]) == 0
    (added,) = Calibration.load(tmp_path / "held").effects
    # that of the second layer has a sigma, so the fit estimates it itself
    assert [*added.parameters] == ["thickness.thickness", "thickness.layer3.thickness"]


def test_the_form_has_a_number_for_each_layer(session: Path) -> None:
    board, _, cover = read_setup(session / "session.yaml")
    typed = write_form(board, cover)
    assert typed.cover["thickness_mm"] == "3, 0.76 ± 0.05, 4.2"
    assert typed.cover["refractive_index"] == "1.52, 1.48, 1.58 ± 0"
    assert read_form(typed)[2] == cover
    for text in ("3, 0.76, 4.2", "3 0.76 ± 0.05; 4.2", "3"):
        assert find_problem("thickness_mm", text, "flat") is None
    assert "thickness_mm is 0.01: write a number" in str(
        find_problem("thickness_mm", "3, 0.01", "flat")
    )
    assert "write 3.5, with a point" in str(find_problem("thickness_mm", "3,5", "flat"))
    assert 'is the text "3 mm"' in str(find_problem("thickness_mm", "3 mm", "flat"))
    unequal = {**typed.cover, "refractive_index": "1.5"}
    with pytest.raises(
        InputError,
        match=r"cover.refractive_index is 1.5 where cover.thickness_mm has 3 layers of glass",
    ):
        read_form(type(typed)(typed.board, "flat", unequal))


def test_the_set_up_takes_it_over_from_another_session(session: Path, tmp_path: Path) -> None:
    new = tmp_path / "session"

    async def story() -> None:
        async with running(new) as pilot:
            await see(pilot, "a new session")
            burst(pilot, "<tab>", str(session), "<enter>")
            await see(pilot, "3, 0.76 ± 0.05, 4.2")
            fields = pilot.app.screen.query("#cover Input").results(Input)
            assert {field.name: field.value for field in fields}["distance_mm"] == "31 ± 2"

    drive(story())
