"""One more shape, in this one file: a paraboloid. From session.yaml to the fit, the report, the
form and the exports, nothing else has to know it.
"""

# ruff: noqa: ARG002 - a paraboloid has no use for some of what the protocol passes.

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import ClassVar

import numpy as np
import pytest
import torch
import yaml
from textual.widgets import Input, Select
from torch import Tensor

import calib
import capture
from calib.calibration import Calibration
from calib.checking.cover_spin import CoverSpin
from calib.cli import main
from calib.effects.cover_offset import CoverOffset
from calib.effects.cover_radius import CoverRadius
from calib.effects.cover_tilt import CoverTilt
from calib.effects.effect import EffectContext
from calib.errors import InputError
from calib.fit_record.request import Settings
from calib.fitting.declared import comparisons
from calib.fitting.fit import fit
from calib.fleet.limits import limit_of
from calib.optics.build import with_relief
from calib.optics.derivatives import ByName
from calib.optics.params import Param, Values
from calib.optics.relief import Relief
from calib.optics.vector import Vector
from calib.progress import Silent
from calib.session.freeing import free_parameters, option_names
from calib.session.parameter_names import COVER, CoverNames
from calib.session.schema import Quantity
from calib.session.session import read_session
from calib.session.shapes import registry
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.flat import FLAT
from calib.session.shapes.shape import CameraOutside, ChartAxis, Numbers, Shape
from calib.session.tolerances import DISTANCE, Tolerance
from capture.tui.form import FormTexts, explain_field, find_problem, read_form, write_form
from tests.capture.tui.driving import drive, running, see
from tests.covers.oracle import Array, rotate, seen_through, views, write_session
from tests.report.made import report_in

BULGE = Tolerance(1e-3, "m", 1e-3, "the mould of a paraboloid")


@dataclass(frozen=True, slots=True)
class Paraboloid:
    """Surfaces z + (x^2 + y^2) / (2 bulge) = height; the thickness is along the axis."""

    names: CoverNames = COVER
    symmetry: ClassVar[str] = "z"

    @property
    def params(self) -> tuple[Param, ...]:
        return (Param(self.names.of("bulge"), "m", 1e-3),)

    def reach(
        self, origin: Vector, direction: Vector, height: Tensor, values: Values
    ) -> tuple[Tensor, Tensor]:
        bulge = values[self.names.of("bulge")]
        a = (direction.x**2 + direction.y**2) / bulge
        b = direction.z + (origin.x * direction.x + origin.y * direction.y) / bulge
        c = self.height(origin, values) - height
        disc = b**2 - 2 * a * c
        below = b + torch.where(disc > 0, disc, torch.ones_like(disc)).sqrt()
        failed = (disc <= 0) | (below <= 1e-9) | (c > 0)
        distance = -2 * c / torch.where(failed, torch.ones_like(below), below)
        return torch.where(failed, torch.zeros_like(distance), distance), failed

    def height(self, points: Vector, values: Values) -> Tensor:
        return points.z + (points.x**2 + points.y**2) / (2 * values[self.names.of("bulge")])

    def gradient(self, points: Vector, values: Values) -> Vector:
        inverse = 1 / values[self.names.of("bulge")]
        return Vector(points.x * inverse, points.y * inverse, torch.ones_like(points.z))

    def chart(self, points: Vector) -> tuple[Tensor, Tensor]:
        return points.y, points.x

    def chart_gradient(self, points: Vector, first: Tensor, second: Tensor) -> Vector:
        return Vector(second, first, torch.zeros_like(points.z))

    def curvature(self, points: Vector, step: Vector, values: Values) -> Vector:
        inverse = 1 / values[self.names.of("bulge")]
        return Vector(step.x * inverse, step.y * inverse, torch.zeros_like(step.z))

    def by_parameters(
        self, points: Vector, by_height: Tensor, by_gradient: Vector, values: Values
    ) -> ByName:
        bulge = values[self.names.of("bulge")]
        steeper = points.x * by_gradient.x + points.y * by_gradient.y
        farther = (points.x**2 + points.y**2) / 2 * by_height
        return {self.names.of("bulge"): -(farther + steeper) / bulge**2}

    def chart_change(self, points: Vector, step: Vector) -> tuple[Tensor, Tensor]:
        return step.y, step.x

    def chart_curvature(
        self, points: Vector, first: Tensor, second: Tensor, step: Vector
    ) -> Vector:
        zero = torch.zeros_like(step.z)
        return Vector(zero, zero, zero)


def _check_camera(numbers: Numbers) -> CameraOutside | None:
    if numbers["apex"] > 0:
        return None
    return CameraOutside("apex_mm", ", behind its apex: write a distance above 0.")


PARABOLOID = Shape(
    "paraboloid",
    "a paraboloid",
    (
        Dimension(
            Quantity("bulge_mm", low=1, high=1e5),
            words="how much the paraboloid bulges",
            explanation="The radius of curvature at its apex, in mm.",
            tolerance=BULGE,
            option="bulge",
            effect="cover_radius",
        ),
        Dimension(
            Quantity("apex_mm", low=-1e5, high=1e5),
            words="how far its apex is from the pinhole (apex_mm)",
            explanation="Millimetres from the lens to its apex.",
            tolerance=DISTANCE,
            option="apex",
            effect="cover_offset",
        ),
        FLAT.dimensions[1],
    ),
    surface=f"{__name__}:Paraboloid",
    origin=(None, None, "apex"),
    chart=(ChartAxis("down the bulge (mm)", 1e3), ChartAxis("across the bulge (mm)", 1e3)),
    check_camera=_check_camera,
    example={"bulge_mm": 60.0, "apex_mm": 40.0, "thickness_mm": 4.0, "refractive_index": 1.49},
)

TRUTH = {"bulge": 0.060, "apex": 0.040, "thickness": 0.004, "refractive_index": 1.49}
TILT = np.radians([4.0, -3.0, 0.0])
WATER = 1.333
COVER_YAML = {
    "shape": "paraboloid",
    "bulge_mm": 60.4,
    "apex_mm": {"value": 39.0, "sigma": 1.5},
    "tilt_deg": [4.0, -3.0],
    "thickness_mm": 4.0,
    "refractive_index": {"value": 1.49, "exact": True},
    "outside_index": WATER,
}


@pytest.fixture(scope="module", autouse=True)
def registered() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "SHAPES", (*registry.SHAPES, PARABOLOID))
        yield


def _inner(points: Array) -> Array:
    local = rotate(-TILT, points - [0.0, 0.0, TRUTH["apex"]])
    return np.asarray(local[:, 2] + (local[:, 0] ** 2 + local[:, 1] ** 2) / (2 * TRUTH["bulge"]))


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory, registered: None) -> Path:  # noqa: ARG001
    glass = TRUTH["refractive_index"]
    see = seen_through(
        [(_inner, 1.0, glass), (lambda p: _inner(p) - TRUTH["thickness"], glass, WATER)]
    )
    return write_session(tmp_path_factory.mktemp("bulge"), COVER_YAML, views(see, 8, 3))


@pytest.fixture(scope="module")
def calibration(session: Path) -> Calibration:
    return fit(read_session(session), Settings(grid=(4, 4)), Silent())


@pytest.mark.parametrize("package", [calib, capture])
def test_no_module_keeps_the_registry_of_before(package: ModuleType) -> None:
    folder = Path(str(package.__file__)).parent
    assert not [path for path in folder.rglob("*.py") if "import SHAPES" in path.read_text()]


def test_its_session_is_read_and_written_back(session: Path, calibration: Calibration) -> None:
    read = read_session(session)
    assert read.cover.parameters["apex"].sigma == pytest.approx(1.5e-3)
    folder = session / "out"
    calibration.save(folder)
    loaded = Calibration.load(folder)
    assert loaded.cover.shape == "paraboloid"
    assert loaded.declared.cover == calibration.declared.cover
    pixels = np.array([[100.0, 200.0], [900.0, 600.0]])
    assert np.abs(loaded.rays(pixels)[0] - calibration.rays(pixels)[0]).max() < 1e-15


def test_the_camera_must_be_inside(session: Path, tmp_path: Path) -> None:
    written = yaml.safe_load((session / "session.yaml").read_text())
    written["cover"]["apex_mm"] = -1.0
    written["corners"] = str(session / "corners.vnl")
    (tmp_path / "session.yaml").write_text(yaml.safe_dump(written))
    with pytest.raises(InputError, match="puts the camera outside the paraboloid, behind its"):
        read_session(tmp_path)


def test_a_fit_finds_its_numbers(calibration: Calibration) -> None:
    """The oracle's views have noise alone, so the numbers come back within their sigma."""
    errors_px = [stage.rms_px for stage in calibration.stages]
    pinhole, smooth, uneven = errors_px
    assert smooth < 0.2 * pinhole
    assert uneven < 0.02
    for name in ("bulge", "apex", "thickness"):
        number = calibration.cover.parameters[name]
        assert abs(number.value - TRUTH[name]) < 4 * number.sigma, name
    assert {row.name: row.unit for row in comparisons(calibration)}["cover.bulge"] == "mm"


def test_its_tolerances_are_those_of_its_file(calibration: Calibration) -> None:
    declared = calibration.declared
    assert declared.cover.parameters["bulge"].sigma == BULGE.sigma
    assert {"bulge", "apex"} <= {*option_names()}

    stated = read_session(Path(calibration.request.session))
    intrinsics = stated.camera.intrinsics
    assert intrinsics
    _, freed = free_parameters(intrinsics, stated.cover, ("bulge",))
    assert freed.parameters["bulge"].sigma == BULGE.sigma
    assert not freed.parameters["thickness"].sigma
    assert limit_of("cover.bulge", {"max": 1.0}, "manifest").name == "cover.bulge"


def test_effects_change_its_numbers(calibration: Calibration) -> None:
    path, values = calibration.model()
    path = with_relief(path, Relief((-1.0, -1.0), (1.0, 1.0), (2, 2)))
    context = EffectContext(calibration.board, 1640, 1232, path, values)
    assert CoverRadius.propose(context)[0].parameters == ("cover.bulge",)
    assert CoverOffset.propose(context)[0].parameters == ("cover.apex",)
    assert CoverTilt.propose(context)[0].axes == "xy"
    assert CoverSpin.propose(context)[0].axes == "z"


def test_the_report_names_it(calibration: Calibration, tmp_path: Path) -> None:
    page = report_in(tmp_path, calibration, (0.4,)).read_text(encoding="utf-8")
    assert "behind a paraboloid (" in page
    assert "down the bulge" in page
    assert "cover.bulge" in page


def test_the_form_has_its_fields(session: Path) -> None:
    setup = read_session(session)
    typed = write_form(setup.board, setup.cover)
    assert typed.cover["bulge_mm"] == "60.4"
    assert read_form(typed)[2] == setup.cover
    assert explain_field("bulge_mm", "checkerboard", "paraboloid").startswith("The radius")
    assert "from 1 to 100000" in str(find_problem("bulge_mm", "0.5", "paraboloid"))
    without_tilt = {key: text for key, text in typed.cover.items() if key != "tilt_deg"}
    read = read_form(FormTexts(typed.board, "paraboloid", without_tilt))[2]
    assert read.parameters["tilt.x"].value == 0


def test_the_set_up_offers_it(tmp_path: Path) -> None:
    async def story() -> None:
        async with running(tmp_path / "session") as pilot:
            await see(pilot, "a new session")
            pilot.app.screen.query_one("#shape", Select).value = "paraboloid"
            await see(pilot, "bulge_mm")
            fields = pilot.app.screen.query("#cover Input").results(Input)
            texts = {field.name: field.value for field in fields}
            assert texts["tilt_deg"] == "0, 0"
            assert texts["outside_index"] == "1"

    drive(story())


def test_it_is_exported_where_a_format_holds_it(
    calibration: Calibration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    calibration.save(tmp_path / "out")
    out = str(tmp_path / "out")
    assert main(["export", out, "--format", "generic", "-o", str(tmp_path / "generic")]) == 0
    assert any((tmp_path / "generic").iterdir())
    assert main(["export", out, "--format", "calibmar", "-o", str(tmp_path / "port")]) != 0
    assert "this cover is a paraboloid" in capsys.readouterr().err
