"""The table of what was calibrated, its JSON, and the cover's cut from the side."""

import json
from dataclasses import replace

import numpy as np
import pytest

from calib.calibration import Calibration
from calib.calibration_content import Stage
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import BoardShape
from calib.effects.thickness import Thickness
from calib.fit_record.request import Settings
from calib.fitting.corner_range import emptiest_region
from calib.fitting.cover_section import cover_section
from calib.fitting.description import (
    COLUMNS,
    PRINTED_COLUMNS,
    calibrated_numbers,
    describe,
    describe_bend,
)
from calib.session.schema import Number
from fixtures.known import known, lens_alone
from fixtures.synthetic import HEIGHT, WIDTH, scene
from tests.fitting.test_declared import with_effect
from tests.optics.shapes import Example, each_shape

LENS = (900.0, 901.0, 310.0, 240.0, -0.25, 0.06, 0.001, -0.002, 0.01)


@pytest.fixture(scope="module")
def plain() -> Calibration:
    """A cone, all of whose numbers are held."""
    return known(scene(1, views=1), WIDTH, HEIGHT)


def test_every_number_of_camera_and_cover_has_a_row(plain: Calibration) -> None:
    table = describe(plain)
    rows = {row[0]: row for section in table.sections for row in section.rows}
    assert {"camera.fx", "camera.fy", "camera.cx", "camera.cy"} <= set(rows)
    assert set(plain.cover.dimensions) <= set(rows)
    assert rows["cover.thickness"] == ("cover.thickness", "3 mm", "3 mm", "not fitted", "")
    assert all(len(row) == len(COLUMNS) for row in rows.values())
    assert [section.name for section in table.sections] == ["camera", "cover"]


def test_a_number_has_its_sigma_what_was_declared_and_how_they_agree(plain: Calibration) -> None:
    cover = plain.cover.replace_numbers({"cover.thickness": Number(0.0042, 0.0001)})
    declared = plain.declared.cover.replace_numbers({"cover.thickness": Number(0.003, 0.0002)})
    stated = replace(plain.declared, cover=declared)
    rows = _rows(replace(plain, cover=cover, stated=stated))
    assert rows["cover.thickness"][:4] == (
        "cover.thickness",
        "4.20 ± 0.10 mm",
        "3.00 ± 0.20 mm",
        "contradicted",
    )


@pytest.mark.parametrize(
    ("index", "sigma", "remark"),
    [(1.506, 0.019, "not improved"), (1.506, 0.015, ""), (1.53, 0.019, "")],
    ids=["as declared", "narrowed", "moved far"],
)
def test_a_number_that_the_pictures_do_not_narrow_is_marked(
    plain: Calibration, index: float, sigma: float, remark: str
) -> None:
    name = "cover.refractive_index"
    cover = plain.cover.replace_numbers({name: Number(index, sigma)})
    declared = plain.declared.cover.replace_numbers({name: Number(1.5, 0.02)})
    rows = _rows(replace(plain, cover=cover, stated=replace(plain.declared, cover=declared)))
    assert rows[name][3] == remark
    assert rows[name][4] == f"{(index - 1.5) / 0.02:.1f} × tolerance"


def test_a_small_difference_from_the_declared_number_is_no_blank(plain: Calibration) -> None:
    name = "cover.refractive_index"
    cover = plain.cover.replace_numbers({name: Number(1.501, 0.01)})
    declared = plain.declared.cover.replace_numbers({name: Number(1.5, 0.02)})
    rows = _rows(replace(plain, cover=cover, stated=replace(plain.declared, cover=declared)))
    assert rows[name][4] == "< 0.1 × tolerance"


def test_a_bend_is_a_guess_where_a_cover_may_be_missing(plain: Calibration) -> None:
    bent = with_effect(plain, BoardScale(), x_over_y=(0.005, 1e-5))
    stages = (Stage("pinhole", 0.5, 0.1), Stage("cover+rbf+effects", 0.1, 0.01))
    command = replace(bent.request, settings=Settings())
    bent = replace(bent, stages=stages, request=command)
    assert describe_bend(bent).startswith("The board is unevenly printed (0.50 % longer")
    assert describe_bend(bent, "may be").startswith("The board may be unevenly printed (")


def test_a_focal_length_that_is_hardly_known_is_marked(plain: Calibration) -> None:
    intrinsics = plain.camera.intrinsics
    assert intrinsics
    vague = replace(intrinsics, fx=Number(640.0, 96.0), fy=Number(640.0, 6.0))
    stated = replace(plain.declared, intrinsics=replace(intrinsics, fx=Number(640.0, 400.0)))
    camera = replace(plain.camera, intrinsics=vague)
    table = describe(replace(plain, camera=camera, stated=stated))
    rows = {row[0]: row for section in table.sections for row in section.rows}
    assert rows["camera.fx"][3] == "hardly known"
    assert rows["camera.fy"][3] != "hardly known"
    assert any(note.startswith("hardly known: ") for note in table.notes)


def test_the_emptiest_part_of_the_picture_has_its_name(plain: Calibration) -> None:
    step = HEIGHT / 24
    x, y = np.meshgrid(np.arange(0, WIDTH, step), np.arange(0, HEIGHT, step))
    corners = np.column_stack([x.ravel(), y.ravel()])
    assert emptiest_region(plain, corners) == ""
    fractions = corners / [WIDTH, HEIGHT]
    at_left = (fractions[:, 0] < 0.31) & (abs(fractions[:, 1] - 0.5) < 0.16)
    assert emptiest_region(plain, corners[~at_left]) == "at the left edge"
    few = at_left & (fractions[:, 0] < 0.05)
    assert emptiest_region(plain, corners[~few]) == "", "a column of cells is not many"


def test_a_lens_has_its_model_and_its_coefficients() -> None:
    calibration = lens_alone(scene(1, views=1), 640, 480, *LENS)
    text = str(describe(calibration))
    assert "Camera: 640x480 px, lens opencv with 5 coefficients" in text
    assert "camera.k1" in text
    assert "-0.25" in text
    numbers = calibrated_numbers(calibration)
    assert numbers["cover"] == {}
    camera = json.loads(json.dumps(numbers["camera"]))
    assert [number["value"] for number in camera["distortion"]] == list(LENS[4:])
    assert camera["lens"] == "opencv"
    assert (camera["width"], camera["height"]) == (640, 480)
    assert camera["fy"] == {"value": 901.0, "sigma": 0.0}


@each_shape
def test_the_json_has_each_number_of_a_cover_by_its_key_in_session_yaml(example: Example) -> None:
    calibration = replace(known(scene(1, views=1), WIDTH, HEIGHT), cover=example.cover)
    numbers = calibrated_numbers(calibration)["cover"]
    assert isinstance(numbers, dict)
    assert len(numbers) == len(example.cover.dimensions)
    thickness = example.cover.parameters["thickness"].value
    assert numbers["thickness_mm"]["value"] == pytest.approx(1e3 * thickness)
    assert numbers["thickness_mm"]["declared"] == pytest.approx(1e3 * thickness)
    assert numbers["thickness_mm"]["unit"] == "mm"
    keys = {kind.quantity.key for kind in example.cover.dimensions.values()}
    assert {key.split(".")[0] for key in numbers} == keys


def test_an_effect_adds_to_its_number_and_the_board_has_its_shape(plain: Calibration) -> None:
    thicker = with_effect(plain, Thickness(("cover.thickness",)), thickness=(0.0015, 0.0001))
    assert calibrated_numbers(thicker)["cover"]["thickness_mm"]["value"] == pytest.approx(4.5)  # type: ignore[index]
    bent = with_effect(
        plain, BoardShape(0.08, 0.08), xx=(0.001, 1e-5), xy=(0.0, 1e-5), yy=(-6e-4, 1e-5)
    )
    stages = (Stage("pinhole", 0.5, 0.1), Stage("cover+rbf+effects", 0.1, 0.01))
    board = calibrated_numbers(replace(bent, stages=stages))["board"]
    assert isinstance(board, dict)
    assert board["shape_mm"]["xx"] == pytest.approx({"value": 1.0, "sigma": 0.01})
    assert board["shape_removed_px"] == {"before": 0.5, "after": 0.1}
    assert calibrated_numbers(plain)["board"]["shape_removed_px"] is None  # type: ignore[index]
    assert "Board" in str(describe(bent))


def test_the_table_fits_into_a_terminal(plain: Calibration) -> None:
    lines = list(describe(plain).first_columns(PRINTED_COLUMNS).lines())
    assert max(map(len, lines)) <= 80


def test_html_is_text(plain: Calibration) -> None:
    named = replace(plain, cover=plain.cover)
    html = describe(named)._repr_html_()
    assert html.count("<table>") == len(describe(named).sections)
    assert "<td><div>cover.thickness</div></td>" in html


@each_shape
def test_the_cut_lies_on_the_cover(example: Example) -> None:
    """The two faces are a thickness apart, up to the slope of the cover, whose thickness counts
    along its radius, and the bend of the rays.
    """
    calibration = replace(
        known(scene(1, views=1), WIDTH, HEIGHT),
        cover=example.cover,
        relief=None,
        amplitudes=np.zeros((0, 0)),
    )
    inner, outer = cover_section(calibration)
    assert len(inner) == len(outer) > 10
    gap = np.linalg.norm(outer - inner, axis=1)
    thickness = example.cover.parameters["thickness"].value
    assert gap.min() > 0.99 * thickness
    assert gap.max() < 1.6 * thickness


def test_without_a_cover_there_is_no_cut() -> None:
    assert cover_section(lens_alone(scene(1, views=1), 640, 480, *LENS)) == ()


def _rows(calibration: Calibration) -> dict[str, tuple[str, ...]]:
    return {row[0]: row for section in describe(calibration).sections for row in section.rows}
