"""The session folder: what is read is what is meant, and what is wrong is said in one sentence."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from calib.corners.corners_file import read_corners
from calib.errors import RefracalError
from calib.session.session import (
    Board,
    Number,
    Session,
    check_images,
    read_session,
    session_from_mapping,
    session_to_yaml,
)
from calib.session.shapes.registry import find_shape, shape_names
from tests.session.malformed import (
    CONE,
    INTRINSICS,
    MALFORMED,
    SESSION,
    WITH_CORNERS,
    Malformed,
    checkerboard,
    write_good_session,
)


def read_everything(folder: Path) -> Session:
    session = read_session(folder)
    check_images(session)
    if session.corners:
        read_corners(session.corners, session.board)
    return session


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_good_session(tmp_path / "session")


@pytest.mark.parametrize("case", MALFORMED, ids=lambda case: case.name)
def test_malformed_session_is_refused_in_one_sentence(case: Malformed, folder: Path) -> None:
    case.spoil(folder)
    with pytest.raises(RefracalError) as caught:
        read_everything(folder)
    sentence = str(caught.value)
    assert caught.value.exit_code == case.exit_code
    assert [words for words in case.says if words not in sentence] == [], sentence
    assert str(folder) in sentence, "names no file"
    assert "\n" not in sentence


@pytest.mark.parametrize("text", [SESSION, WITH_CORNERS], ids=["frames", "corners"])
def test_good_session_is_accepted(text: str, folder: Path) -> None:
    """The table's negative control."""
    (folder / "session.yaml").write_text(text)
    session = read_everything(folder)
    assert session.board == Board(6, 5, 0.02)
    assert [frame.name for frame in session.frames] == ["0000.png", "0001.jpg", "0002.png"]
    assert session.corners == (folder / "corners.vnl" if text == WITH_CORNERS else None)


def test_numbers_are_in_si_units_and_defaults_are_filled_in(folder: Path) -> None:
    changed = (
        CONE.replace("3.0", "{value: 3.0, sigma: 0.5}")
        + "  tilt_deg: [-9, {value: 18, sigma: 1.8}]\n"
    )
    (folder / "session.yaml").write_text(SESSION.replace(CONE, changed))
    cover = read_session(folder).cover
    assert cover.shape == "cone"
    assert cover.parameters["inner_radius"] == Number(0.04195)
    assert cover.parameters["axis_offset.z"] == Number(-0.03)
    assert cover.parameters["thickness"] == Number(0.003, sigma=0.0005)
    assert cover.parameters["outside_index"] == Number(1.0)
    assert cover.parameters["tilt.x"].value == pytest.approx(-math.pi / 20)
    assert cover.parameters["tilt.z"].value == pytest.approx(math.pi / 10)
    assert cover.parameters["tilt.z"].sigma == pytest.approx(math.pi / 100)


def test_yaml_numbers_are_read_as_people_write_them(folder: Path) -> None:
    """YAML 1.1 would read 1e-1 as text, 0600 as octal and 1:30 as 90."""
    (folder / "session.yaml").write_text(
        SESSION.replace("-0.105", "-1e-1").replace("drawn", "1:30").replace("20.0", "020")
    )
    session = read_session(folder)
    assert session.cover.parameters["radius_slope"] == Number(-0.1)
    assert session.camera.model == "1:30"
    assert session.board.square == 0.02


@pytest.mark.parametrize(
    ("written", "sigma", "relative"),
    [
        ("20.0", None, 0.002),
        ("{value: 20.0, sigma: 0.05}", 5e-5, 0.0025),
        ("{value: 20.0, exact: true}", 0.0, 0.0),
    ],
)
def test_the_sigma_of_a_square_is_read_and_written(
    folder: Path, written: str, sigma: float | None, relative: float
) -> None:
    (folder / "session.yaml").write_text(
        SESSION.replace("square_mm: 20.0", f"square_mm: {written}")
    )
    session = read_session(folder)
    board = session.board
    assert board.square_sigma == sigma
    assert board.relative_sigma == pytest.approx(relative)
    read_back, *_ = session_from_mapping(
        session_to_yaml(board, session.camera, session.cover), "here"
    )
    assert read_back.square_sigma == sigma


@pytest.mark.parametrize("digits", [15, 17])
@pytest.mark.parametrize("shape", shape_names())
def test_written_setup_reads_as_the_same_numbers(shape: str, digits: int) -> None:
    """Through a YAML file, with every key of each shape.

    Numbers that a person could have written come back to the digit.
    """
    rng = np.random.default_rng(7)
    for _ in range(50):
        mapping = random_setup(shape, rng, digits)
        setup = session_from_mapping(mapping, "here")
        read_back = yaml.safe_load(yaml.safe_dump(session_to_yaml(*setup)))
        assert session_from_mapping(read_back, "there") == setup
        assert read_back == mapping or digits == 17


def random_setup(shape: str, rng: np.random.Generator, digits: int) -> dict[str, object]:
    def uniform(low: float, high: float) -> float:
        return float(f"{rng.uniform(low, high):.{digits}g}")

    def number(low: float, high: float) -> object:
        value = uniform(low, high)
        return value if rng.random() < 0.5 else {"value": value, "sigma": uniform(1e-3, 1)}

    cover: dict[str, object] = {"shape": shape}
    for quantity in (dimension.quantity for dimension in find_shape(shape).keys):
        large = quantity.key.startswith("inner_radius")  # so that the camera is inside
        low, high = (100, 200) if large else (max(quantity.low, -20), min(quantity.high, 20))
        entries = [number(low, high) for _ in quantity.names]
        cover[quantity.key] = entries if quantity.components else entries[0]
    if shape != "none":
        cover["correlations"] = [["cover.thickness", "camera.fx", uniform(-0.05, 0.05)]]
    model = ("opencv", "fisheye", "splined")[rng.integers(3)]
    count = 8 if model == "opencv" else 4
    intrinsics: dict[str, object] = {} if model == "opencv" else {"model": model}
    intrinsics |= {key: number(300, 400) for key in ("fx", "fy", "cx", "cy")} | {
        "distortion": [number(-1, 1) for _ in range(count)]
    }
    if model == "splined":
        intrinsics["spline"] = {"columns": 4, "rows": 5} | {
            key: [uniform(-9, 9) for _ in range(20)] for key in ("x_px", "y_px")
        }
    intrinsics["correlations"] = [
        [uniform(-0.05, 0.05) for _ in range(row)] for row in range(1, count + 4)
    ]
    camera = {
        "width": 320,
        "height": 240,
        "model": "any",
        "intrinsics": intrinsics,
        **({"lens_coefficients": 8} if model == "opencv" else {"lens": model}),
        "shutter": {"type": "rolling", "readout_ms": 33.3},
    }
    return {
        "board": {"columns": 6, "rows": 5, "square_mm": uniform(1, 100)},
        "camera": camera,
        "cover": cover,
    }


def test_tilted_axis_is_what_the_camera_must_be_inside_of(folder: Path) -> None:
    """42 mm before a radius of 41.95 mm; a tilt of 10 degrees about x brings a cylinder's axis to
    42 cos(10 deg) = 41.4 mm.
    """
    cylinder = (
        CONE.replace("cone", "cylinder")
        .replace("  radius_slope: -0.105\n", "")
        .replace("-30.0", "-42.0")
    )
    (folder / "session.yaml").write_text(SESSION.replace(CONE, cylinder))
    with pytest.raises(RefracalError, match="outside the cylinder"):
        read_session(folder)
    (folder / "session.yaml").write_text(SESSION.replace(CONE, cylinder + "  tilt_deg: [10, 0]\n"))
    assert read_session(folder).cover.shape == "cylinder"


@pytest.mark.parametrize(("tilt", "is_inside"), [(20, False), (-20, True)])
def test_cone_is_measured_beside_the_camera(tilt: int, is_inside: bool, folder: Path) -> None:
    """The axis passes behind the camera.

    Tipped forwards it comes by further down, where this cone is narrower by 10 mm; else wider.
    """
    steep = CONE.replace("-0.105", "-1.0").replace("41.95", "36.0") + f"  tilt_deg: [{tilt}, 0]\n"
    (folder / "session.yaml").write_text(SESSION.replace(CONE, steep))
    if is_inside:
        assert read_session(folder).cover.parameters["inner_radius"] == Number(0.036)
    else:
        with pytest.raises(
            RefracalError, match=r"28\.19.* mm from its axis where the inner radius is 25\.7"
        ):
            read_session(folder)


def test_suggested_minimal_session_is_one(folder: Path) -> None:
    (folder / "session.yaml").unlink()
    with pytest.raises(RefracalError) as caught:
        read_session(folder)
    suggestion = str(caught.value).partition("at the least ")[2]
    (folder / "session.yaml").write_text(suggestion)
    assert read_session(folder).board == Board(9, 6, 0.025)


def test_bare_pictures_share_board_and_size(folder: Path) -> None:
    (folder / "session.yaml").write_text(SESSION.replace(INTRINSICS, ""))
    (folder / "bare").mkdir()
    np.save(folder / "bare" / "0.npy", checkerboard(50, 30))
    session = read_everything(folder)
    assert session.bare is not None
    assert (session.bare.board, session.bare.camera, session.bare.cover.shape) == (
        session.board,
        session.camera,
        "none",
    )
    assert session.bare.frames == (folder / "bare" / "0.npy",)


def test_bare_session_has_its_own_board_and_corners(folder: Path) -> None:
    (folder / "session.yaml").write_text(SESSION.replace(INTRINSICS, ""))
    text = (
        WITH_CORNERS.replace(CONE, "  shape: none\n")
        .replace("columns: 6", "columns: 7")
        .replace("corners.vnl", "../corners.vnl")
    )
    (folder / "bare").mkdir()
    (folder / "bare" / "session.yaml").write_text(text)
    bare = read_session(folder).bare
    assert bare is not None
    assert bare.board.columns == 7
    assert bare.corners is not None
    assert bare.corners.samefile(folder / "corners.vnl")


def test_damaged_bare_picture_is_found(folder: Path) -> None:
    (folder / "bare").mkdir()
    np.save(folder / "bare" / "0.npy", checkerboard(50, 30)[:100])
    with pytest.raises(RefracalError, match=r"0\.npy is 320x100 px"):
        check_images(read_session(folder))


@pytest.mark.parametrize("written", ["inner_radius_mm: unknown", "inner_radius_mm: Unknown", ""])
def test_unknown_and_missing_numbers_are_a_wide_prior(folder: Path, written: str) -> None:
    (folder / "session.yaml").write_text(SESSION.replace("inner_radius_mm: 41.95", written))
    radius = read_session(folder).cover.parameters["inner_radius"]
    assert radius == Number(0.06, 0.06, unknown=True)
    session = read_session(folder)
    again = session_to_yaml(session.board, session.camera, session.cover)
    assert session_from_mapping(again, "here")[2] == session.cover
    assert yaml.safe_load(yaml.safe_dump(again))["cover"]["inner_radius_mm"] == "unknown"


def test_lists_may_have_an_unknown_number_or_be_unknown(folder: Path) -> None:
    for written, expected in (("[0.0, unknown]", [False, True]), ("unknown", [True, True])):
        (folder / "session.yaml").write_text(SESSION.replace("[0.0, -30.0]", written))
        parameters = read_session(folder).cover.parameters
        assert [parameters[f"axis_offset.{axis}"].unknown for axis in "xz"] == expected


@pytest.mark.parametrize("offset", [-80.0, 700.0])
def test_unknown_radius_leaves_room_for_the_camera(folder: Path, offset: float) -> None:
    text = SESSION.replace("inner_radius_mm: 41.95", "inner_radius_mm: unknown")
    (folder / "session.yaml").write_text(text.replace("-30.0", str(offset)))
    assert read_session(folder).cover.parameters["inner_radius"].value > abs(offset) / 1000


@pytest.mark.parametrize("written", ["  intrinsics: unknown\n", ""])
def test_unknown_intrinsics_are_within_the_picture(folder: Path, written: str) -> None:
    (folder / "session.yaml").write_text(SESSION.replace(INTRINSICS, written))
    intrinsics = read_session(folder).camera.intrinsics
    assert intrinsics
    assert intrinsics.is_unknown
    assert (intrinsics.cx.value, intrinsics.cy.value) == (159.5, 119.5)
    assert intrinsics.fx == Number(320.0, 224.0, unknown=True)


def test_shape_may_be_unknown_with_glass_that_is_known(folder: Path) -> None:
    glass = "  shape: unknown\n  thickness_mm: 3.0\n"
    (folder / "session.yaml").write_text(SESSION.replace(CONE, glass))
    cover = read_session(folder).cover
    assert cover.has_unknown_shape
    assert cover.parameters["thickness"] == Number(0.003)
    assert cover.parameters["refractive_index"].unknown
    for shape in shape_names():
        assert cover.as_shape(shape).shape == shape
    assert cover.as_shape("dome").parameters["centre.z"].unknown
    (folder / "session.yaml").write_text(SESSION.replace("cover:\n" + CONE, "cover: unknown\n"))
    assert read_session(folder).cover.has_unknown_shape


def test_estimate_may_lie_outside_of_the_limits_by_its_sigma(folder: Path) -> None:
    """The index of air comes out below 1 half of the time; a radius stays positive."""
    glass = "  outside_index: {value: 0.9999, sigma: 0.0001}\n"
    (folder / "session.yaml").write_text(SESSION + glass)
    assert read_session(folder).cover.parameters["outside_index"].value < 1
    for wrong in ("  outside_index: 0.9999\n", "  outside_index: {value: 0.9, sigma: 0.01}\n"):
        (folder / "session.yaml").write_text(SESSION + wrong)
        with pytest.raises(RefracalError, match="from 1 to 3"):
            read_session(folder)
