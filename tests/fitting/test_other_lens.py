"""Another lens than the declared one, as the rival of uneven glass."""

from dataclasses import replace

import numpy as np
import pytest

from calib.calibration import Calibration
from calib.fit_record.request import Settings
from calib.fitting.declared import comparisons
from calib.fitting.setup import Setup
from calib.session.camera import Intrinsics
from calib.session.parameter_names import CAMERA
from calib.session.schema import Number
from calib.verdict.bare_pictures import rival_lens
from calib.verdict.declared_numbers import declared_numbers
from fixtures.calibrated import CAMERA as PICTURES
from fixtures.calibrated import calibrated, with_outcome
from fixtures.synthetic import COVERS, INTRINSICS, Scene, misdeclared, scene
from tests.verdict.cases import asked

SIGMA = 0.5
"""px: that of a lens from pictures without the cover."""


def made(cover_name: str, amplitude: float = 0.0) -> Scene:
    cover, _ = COVERS[cover_name]
    return scene(7, 24, amplitude=amplitude, noise=0.1, depths=(0.4, 1.2), cover=cover)


def lens(zoom: float = 1.0, x: float = 0.0, y: float = 0.0) -> Intrinsics:
    """Return the lens as pictures at another zoom, or cropped by so many px, would show it."""
    k = INTRINSICS
    return Intrinsics(
        Number(zoom * k.fx.value, sigma=SIGMA),
        Number(zoom * k.fy.value, sigma=SIGMA),
        Number(k.cx.value + x, sigma=SIGMA),
        Number(k.cy.value + y, sigma=SIGMA),
        tuple(replace(number, sigma=3e-4) for number in k.distortion),
    )


def fit_with(scene_made: Scene, declared: Intrinsics) -> Calibration:
    setup = Setup(scene_made.board, PICTURES, declared, scene_made.cover)
    return calibrated(scene_made, setup, Settings())


def test_cropped_pictures_without_the_cover_are_named_and_not_uneven_glass() -> None:
    calibration = fit_with(made("thin-cone"), lens(x=8.0, y=-5.0))
    assert calibration.relief is None
    assert calibration.declared.doubted == CAMERA.centre
    numbers = {number.name: number for number in comparisons(calibration)}
    for name, truth in zip(CAMERA.centre, (INTRINSICS.cx, INTRINSICS.cy), strict=True):
        assert numbers[name].contradicted
        assert abs(numbers[name].estimate - truth.value) < 3 * numbers[name].sigma
    suspects = {name for reason in asked(declared_numbers, calibration) for name in reason.suspects}
    assert suspects == set(CAMERA.centre)


@pytest.mark.parametrize("declared", [lens(), lens(0.996)], ids=["right", "zoomed"])
def test_uneven_glass_is_no_other_lens(declared: Intrinsics) -> None:
    calibration = fit_with(made("thin-cone", 1e-5), declared)
    assert calibration.relief
    assert not calibration.declared.doubted


def test_one_focal_length_alone_is_no_other_lens() -> None:
    """Even glass with a larger fy is more probable than this uneven glass, by e^25."""
    cover, _ = COVERS["cylinder"]
    uneven = scene(501, 24, amplitude=5e-6, noise=0.1, depths=(0.4, 1.2), cover=cover)
    rng = np.random.default_rng([501, 2])
    _, declared = misdeclared(rng, INTRINSICS, cover)

    def off(number: Number) -> Number:
        return Number(number.value + rng.normal(0, number.sigma), number.sigma)

    k = lens()
    fx, fy, cx, cy = map(off, (k.fx, k.fy, k.cx, k.cy))
    measured = Intrinsics(fx, fy, cx, cy, tuple(map(off, k.distortion)))
    setup = Setup(uneven.board, PICTURES, measured, declared)
    calibration = calibrated(uneven, setup, Settings())
    assert calibration.relief
    assert not calibration.declared.doubted


def test_a_lens_that_fits_as_well_widens_sigma_and_is_named() -> None:
    calibration = fit_with(made("dome"), lens())
    rival = {CAMERA.fx: 2568.4, CAMERA.fy: 2568.4, CAMERA.cx: 1666.0, CAMERA.cy: 1274.0}
    either = with_outcome(
        calibration,
        intrinsics_from="bare",
        rival_lens=rival,
        shape_camera_sigma={CAMERA.fx: 7.0, CAMERA.fy: 7.0},
    )
    fx = next(number for number in comparisons(either) if number.name == CAMERA.fx)
    assert fx.sigma == 7.0
    assert fx.alternatives == "either lens"
    (note,) = asked(rival_lens, either)
    assert "camera.fx 2568.4 in place of 2558.4 px" in note
    assert "cx" not in note
