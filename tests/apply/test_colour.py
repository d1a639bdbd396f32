"""The cover's colour fringes: predicted, removed, and refused where nothing is known of them."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.apply.change_medium import replace_medium
from calib.apply.colour import ColourUndistorter, channel_calibration, predict_fringes
from calib.apply.undistorter import Undistorter
from calib.apply.water import dispersion_of_water
from calib.calibration import Calibration
from calib.cli import main
from calib.errors import InputError
from calib.progress import Silent
from calib.session.cover import Cover
from calib.session.dispersion import BLUE, CHANNELS, GREEN, RED, Dispersion
from calib.session.schema import Number
from fixtures.known import lens_alone
from fixtures.lateral_colour import measure, summary
from fixtures.rays import FIXTURES
from fixtures.synthetic import scene

F, CENTRE = 160.0, (100.0, 75.0)
W, H = 201, 151
NUMBERS = {
    "distance": 0.02,
    "tilt.x": 0.0,
    "tilt.y": 0.0,
    "thickness": 0.006,
    "refractive_index": 1.49,
    "outside_index": 1.333,
}
DISPERSION = {"refractive_index": Dispersion(abbe=57), "outside_index": Dispersion(abbe=55)}
WINDOW = Cover(
    "flat", {name: Number(value) for name, value in NUMBERS.items()}, dispersion=DISPERSION
)


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    """A camera behind a window under water."""
    bare = lens_alone(scene(1, views=1), W, H, F, F, *CENTRE)
    return replace(bare, cover=WINDOW)


def seen_height(calibration: Calibration, channel: str, radius: float, depth: float) -> float:
    """Return the tangent at the pinhole of the ray to a point `radius` m off the axis, by bisection
    on Snell's law: an oracle that knows nothing of the ray path.
    """
    numbers = calibration.cover.in_channel(channel).parameters
    glass, water = numbers["refractive_index"].value, numbers["outside_index"].value
    low, high = 0.0, 2.0
    for _ in range(80):
        middle = (low + high) / 2
        sine = middle / np.hypot(1, middle)
        reached = 0.02 * middle
        for thickness, index in ((0.006, glass), (depth - 0.026, water)):
            bent = sine / index
            reached += thickness * bent / np.sqrt(1 - bent**2)
        low, high = (middle, high) if reached < radius else (low, middle)
    return low


def test_fringes_are_those_of_snells_law(calibration: Calibration) -> None:
    (fringes,) = predict_fringes(calibration, [0.5])
    row, column = 3, 8  # the right edge, level with the axis
    assert fringes.rows[row] == CENTRE[1]
    pixel = np.array([[fringes.columns[column], fringes.rows[row]]])
    origin, direction = calibration.rays(pixel)
    radius = float(origin[0, 0] + direction[0, 0] / direction[0, 2] * (0.5 - origin[0, 2]))
    red = seen_height(calibration, RED, radius, 0.5)
    blue = seen_height(calibration, BLUE, radius, 0.5)
    assert fringes.shift[row, column, 0] == pytest.approx(F * (red - blue), abs=1e-6)
    assert abs(fringes.shift[row, column, 0]) > 0.2


def test_an_abbe_number_is_that_of_its_lines() -> None:
    """Cauchy's equation through the three spectral lines gives the number back."""
    channels = {c: Dispersion(abbe=57).index(1.49, c) for c in CHANNELS}
    slope = (channels[BLUE] - channels[RED]) / (465.0**-2 - 610.0**-2)
    yellow = channels[GREEN] + slope * (587.56**-2 - 550.0**-2)
    assert (yellow - 1) / (slope * (486.13**-2 - 656.27**-2)) == pytest.approx(57)
    assert channels[RED] < channels[GREEN] == 1.49 < channels[BLUE]
    water = dispersion_of_water(0.0, 20.0)
    assert water.red < 0 < water.blue


def test_undistorted_channels_coincide(calibration: Calibration) -> None:
    """A straight stripe that each channel sees through its own rays is straight and grey again."""
    rows, columns = np.mgrid[:H, :W]
    pixels = np.stack([columns, rows], -1).reshape(-1, 2).astype(np.float64)
    planes = []
    for channel in (BLUE, GREEN, RED):
        origins, directions = channel_calibration(calibration, channel)._trace(pixels)
        at = origins + directions * ((0.5 - origins[:, 2:]) / directions[:, 2:])
        planes.append(128 + 100 * np.sin(at[:, 0] * 150).reshape(H, W))
    image = np.rint(np.dstack(planes)).astype(np.uint8)
    undistorter = ColourUndistorter(calibration, 0.5, crop=0.0)
    straight = undistorter.undistort(image).astype(np.int64)
    assert undistorter.valid.all(), "crop 0 leaves no pixel that is not seen"
    # At its edge a picture is as in the middle of its last pixel.
    assert np.ptp(straight[1:-1, 1:-1], axis=-1).max() <= 3  # rounded, interpolated linearly
    single = Undistorter(calibration, 0.5, crop=0.0).undistort(image).astype(np.int64)
    assert np.ptp(single, axis=-1).max() > 12
    assert undistorter.at(0.3).undistort(image).shape == image.shape


def test_what_has_no_colours_is_refused(calibration: Calibration) -> None:
    with pytest.raises(InputError, match="leave --colour out"):
        ColourUndistorter(calibration, 0.5).undistort(np.zeros((H, W), np.uint8))
    plain = replace(calibration, cover=replace(calibration.cover, dispersion={}))
    assert predict_fringes(plain, [0.5]) == ()
    with pytest.raises(InputError, match="abbe: 57"):
        ColourUndistorter(plain, 0.5)


def test_another_medium_has_its_own_dispersion(calibration: Calibration) -> None:
    views_gone = replace(calibration, corners_at=np.array([[50.0, 50.0, 0.5]]))
    sea = replace_medium(views_gone, Number(1.34), Dispersion(red=-0.002, blue=0.004))
    assert sea.cover.in_channel(BLUE).parameters["outside_index"].value == pytest.approx(1.344)
    air = replace_medium(views_gone, Number(1.0))
    assert tuple(air.cover.dispersion) == ("refractive_index",)


@pytest.mark.slow
def test_a_rendered_session_loses_its_fringes() -> None:
    colour = measure(Silent())
    assert summary(colour.predicted)[0] == pytest.approx(summary(colour.true)[0], rel=0.05)
    assert summary(colour.single)[0] > 0.6
    assert summary(colour.channels)[0] < 0.06  # the detector's noise is 0.04


@pytest.mark.slow
def test_the_commands_know_colours(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session, out = tmp_path / "colour", tmp_path / "out"
    shutil.copytree(FIXTURES / "colour", session)
    words = ["fit", session, "-o", out, "--depth", 0.5, "--json"]
    assert main([str(word) for word in words]) == 0
    (fringe,) = json.loads(capsys.readouterr().out)["colour"]["fringes"]
    assert fringe["depth_m"] == 0.5
    assert fringe["largest_px"] > 3
    assert "Colour fringes" in (out / "report.html").read_text(encoding="utf-8")
    picture = session / "frames" / "0000.jpg"
    straight = ["undistort", out, picture, "--depth", 0.5, "--colour", "-o", tmp_path / "straight"]
    assert main([str(word) for word in straight]) == 0
    maps = ["export", out, "--format", "npz", "--channels", "-o", tmp_path / "maps"]
    assert main([str(word) for word in maps]) == 0
    red = np.load(tmp_path / "maps" / "red" / "rays.npz")
    blue = np.load(tmp_path / "maps" / "blue" / "rays.npz")
    assert not np.array_equal(red["at_infinity"], blue["at_infinity"])
