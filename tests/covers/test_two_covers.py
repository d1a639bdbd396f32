"""A window in front of a dome: two covers with air between them, and water outside."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from calib.apply.change_medium import immerse
from calib.calibration import Calibration
from calib.cli import main
from calib.effects.cover_offset import CoverOffset
from calib.effects.cover_tilt import CoverTilt
from calib.effects.effect import EffectContext
from calib.errors import InputError
from calib.fit_record.request import Settings
from calib.fitting.declared import comparisons
from calib.fitting.fit import fit
from calib.optics.exposure import MIDDLE
from calib.optics.rays import FAILURES
from calib.progress import Silent
from calib.session.cover_section import cover_sections, cover_to_yaml, read_cover
from calib.session.schema import Number, Section
from calib.session.session import read_session
from calib.verdict.judge import judge
from capture.session_file import read_setup
from capture.tui.draft import Draft, load_draft, save_draft
from capture.tui.form import read_form, write_form
from tests.capture.tui.driving import burst, drive, running, see
from tests.covers.oracle import Array, rotate, seen_through, trace, views, write_session
from tests.report.made import report_in

WATER = 1.333
RADIUS, CENTRE = 0.05, np.array([0.0, 0.0, -0.012])
DOME = {
    "shape": "dome",
    "inner_radius_mm": 50.0,
    "centre_mm": [0.0, 0.0, {"value": -11.0, "sigma": 2.0}],
    "thickness_mm": 3.0,
    "refractive_index": 1.49,
}
DISTANCE, TILT = 0.06, np.radians([5.0, 0.0, 0.0])
WINDOW = {
    "shape": "flat",
    "distance_mm": {"value": 61.0, "sigma": 2.0},
    "tilt_deg": [5.0, 0.0],
    "thickness_mm": 6.0,
    "refractive_index": 1.52,
    "outside_index": WATER,
}
COVERS = [DOME, WINDOW]


def inner_face(points: Array) -> Array:
    return np.asarray(np.linalg.norm(points - CENTRE, axis=-1) - RADIUS)


def window_face(points: Array) -> Array:
    return np.asarray(rotate(-TILT, points - [0.0, 0.0, DISTANCE])[:, 2])


SURFACES = (
    (inner_face, 1.0, 1.49),
    (lambda p: inner_face(p) - 0.003, 1.49, 1.0),
    (window_face, 1.0, 1.52),
    (lambda p: window_face(p) - 0.006, 1.52, WATER),
)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("covers")
    return write_session(folder, COVERS, views(seen_through(SURFACES), 8, 6))


@pytest.fixture(scope="module")
def calibration(session: Path) -> Calibration:
    return fit(read_session(session), Settings(grid=(4, 4)), Silent())


def read(covers: object) -> object:
    return read_cover(*cover_sections(Section({"cover": covers}, "session.yaml"), ""))


@pytest.mark.slow
def test_each_cover_has_its_numbers(session: Path) -> None:
    cover = read_session(session).cover
    assert [single.shape for single in cover.covers] == ["dome", "flat"]
    assert cover.numbers["cover.inner_radius"] == Number(0.05)
    assert cover.numbers["cover.outside_index"] == Number(1.0)
    assert cover.numbers["cover2.distance"] == Number(0.061, 0.002)
    assert (cover.medium_name, cover.medium) == ("cover2.outside_index", Number(WATER))
    assert {*cover.numbers} == {*cover.dimensions}
    assert read(cover_to_yaml(cover)) == cover
    related = replace(cover, correlations=(("cover.thickness", "cover2.thickness", 0.5),))
    assert read(cover_to_yaml(related)) == related


@pytest.mark.parametrize(
    ("covers", "message"),
    [
        ([DOME], "cover is a list of 1: write a mapping, or a list of 2 to 4 mappings"),
        ([DOME, 3], "cover is a list of 2: write a mapping"),
        (
            [{"shape": "none"}, WINDOW],
            r"cover\[0\].shape is the text \"none\": write .*one of cone",
        ),
        ([DOME, WINDOW | {"distance_mm": 0}], r"cover\[1\].distance_mm is 0: write a number from"),
        ([DOME, WINDOW | {"glass": {}}], r"cover\[1\].glass is not a key of the shape flat"),
        ([DOME | {"centre_mm": [0, 0, -90]}, WINDOW], r"cover\[0\].centre_mm puts the camera"),
    ],
)
def test_covers_that_are_not_whole_are_refused(covers: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read(covers)


def test_its_rays_are_those_of_a_tracer_by_bisection(calibration: Calibration) -> None:
    truth = {"cover.centre.z": Number(-0.012), "cover2.distance": Number(DISTANCE)}
    cover = calibration.declared.cover.replace_numbers(truth)
    exact = replace(
        calibration,
        cover=cover,
        relief=None,
        amplitudes=np.zeros((0, 0)),
        covariance=np.zeros((0, 0)),
    )
    pixels = np.random.default_rng(2).uniform([0, 0], [1640, 1232], (50, 2))
    origins, directions = trace(SURFACES, pixels)
    stated = replace(calibration.camera, intrinsics=calibration.declared.intrinsics)
    ours = replace(exact, camera=stated).rays(pixels)
    assert np.abs(ours[0] - origins).max() < 1e-10
    assert np.abs(ours[1] - directions).max() < 1e-8  # numeric normals


def test_a_fit_finds_where_they_stand(calibration: Calibration) -> None:
    errors_px = [stage.rms_px for stage in calibration.stages]
    pinhole, smooth, uneven = errors_px
    assert smooth < 0.2 * pinhole
    assert uneven < 0.02
    for name, truth in (("cover2.distance", DISTANCE), ("cover.centre.z", CENTRE[2])):
        number = calibration.cover.numbers[name]
        assert abs(number.value - truth) < 4 * number.sigma, name
    assert {row.name: row.unit for row in comparisons(calibration)}["cover2.tilt.x"] == "deg"


def test_a_failure_names_its_surface(calibration: Calibration) -> None:
    """A window that stands inside the dome is missed from outside."""
    moved = calibration.cover.replace_numbers({"cover2.distance": Number(0.02)})
    path, values = replace(calibration, cover=moved).model()
    rays = path.trace(torch.tensor([[830.0, 620.0]], dtype=torch.float64), values, MIDDLE)
    assert FAILURES[int(rays.failure[0])] == "missed the cover's surface 3"
    assert [FAILURES[stage.failures[0]] for stage in path.cover] == [
        "missed the cover's inner surface",
        "missed the cover's surface 2",
        "missed the cover's surface 3",
        "missed the cover's outer surface",
    ]


def test_effects_are_of_the_outermost_cover(calibration: Calibration) -> None:
    path, values = calibration.model()
    context = EffectContext(calibration.board, 1640, 1232, path, values)
    (tilt,) = CoverTilt.propose(context)
    assert (tilt.axes, tilt.stated) == ("xy", ("cover2.tilt.x", "cover2.tilt.y"))
    turned = [bool(stage.frame.extra_tilts) for stage in tilt.apply(path).cover]
    assert turned == [False, False, True, True]
    names = [
        parameter.param.name for parameter in CoverOffset.propose(context)[0].effect_parameters
    ]
    assert names[0] == "cover_offset.centre.x"
    assert names[-1] == "cover_offset.cover2.distance"


def test_it_is_saved_and_loaded(calibration: Calibration, tmp_path: Path) -> None:
    calibration.save(tmp_path)
    loaded = Calibration.load(tmp_path)
    for name, number in loaded.cover.numbers.items():  # millimetres in the file cost the last bit
        assert number.value == pytest.approx(calibration.cover.numbers[name].value, rel=1e-15)
    assert loaded.declared.cover == calibration.declared.cover


def test_report_verdict_check_and_medium_take_it(
    session: Path, calibration: Calibration, tmp_path: Path
) -> None:
    calibration.save(tmp_path / "out")
    page = report_in(tmp_path / "out", calibration, (0.4,)).read_text(encoding="utf-8")
    assert "behind a dome (3" in page
    assert " and a flat window (" in page
    assert "cover2.distance" in page
    assert judge(calibration).word
    assert main(["check", str(tmp_path / "out"), str(session)]) == 0
    dry = immerse(calibration, Number(1.0))
    assert dry.calibration.cover.numbers["cover2.outside_index"] == Number(1.0)
    assert dry.calibration.cover.numbers["cover.outside_index"] == Number(1.0)
    assert np.isfinite(dry.other_face_px).all()


def test_it_is_exported_where_a_format_holds_it(
    calibration: Calibration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibration.save(tmp_path / "out")
    out, folder = str(tmp_path / "out"), str(tmp_path / "generic")
    assert main(["export", out, "--format", "generic", "-o", folder]) == 0
    assert main(["export", out, "--format", "calibmar", "-o", str(tmp_path / "port")]) != 0
    assert "one layer of glass" in capsys.readouterr().err


def test_the_form_keeps_both(
    session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    board, _, cover = read_setup(session / "session.yaml")
    typed = write_form(board, cover)
    assert (typed.shape, len(typed.outer)) == ("dome", 1)
    assert read_form(typed)[2] == cover
    save_draft(tmp_path, Draft(typed, "folder:x", ""))
    draft = load_draft(tmp_path)
    assert draft
    assert read_form(draft.typed)[2] == cover


def test_the_set_up_shows_and_keeps_both(session: Path, tmp_path: Path) -> None:
    async def story() -> None:
        async with running(tmp_path / "session") as pilot:
            await see(pilot, "a new session")
            burst(pilot, "<tab>", str(session), "<enter>")
            await see(pilot, "outside of it: a flat window")
            typed = pilot.app.screen._form.typed  # type: ignore[attr-defined]
            assert read_form(typed)[2] == read_session(session).cover

    drive(story())
