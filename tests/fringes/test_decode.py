"""Decoding against a simulated camera that looks up what is drawn where its rays meet a screen."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.errors import InputError
from calib.fringes.decode import DecodedScreen, PixelReason, decode_fringes, screen_points
from calib.fringes.pattern import FringePlan, Screen, Unwrapping
from fixtures.screen import Floats, ScreenCamera, place_errors

SCREEN = Screen(420, 320, (2.0e-4, 2.02e-4))
PLAN = FringePlan(SCREEN, 20.0)
CAMERA = ScreenCamera(width=160, height=120)
SMALL = ScreenCamera(width=80, height=60)


def decode(camera: ScreenCamera, plan: FringePlan = PLAN) -> DecodedScreen:
    return decode_fringes(camera.photograph(plan.screen, plan.draw()), plan)


@pytest.mark.parametrize("unwrapping", Unwrapping)
def test_a_pixel_is_off_by_two_hundredths_at_most_and_knows_it(unwrapping: Unwrapping) -> None:
    """Noise of 2 grey levels, a blur of 1.5 px, gamma 2.2, JPEG of quality 90."""
    points = screen_points(decode(CAMERA, replace(PLAN, unwrapping=unwrapping)))
    errors = place_errors(points, CAMERA, SCREEN)
    assert len(errors.pixels) > 0.95 * CAMERA.width * CAMERA.height / 9
    assert errors.rms_px < 0.02
    assert 0.8 < errors.deviation < 1.25


def test_the_noise_is_told_by_the_pictures() -> None:
    """The variance of the errors follows it."""
    camera = replace(CAMERA, noise=6.0, jpeg=None)
    errors = place_errors(screen_points(decode(camera)), camera, SCREEN)
    assert 0.8 < errors.deviation < 1.25
    assert errors.rms_px == pytest.approx(0.031, rel=0.15)  # three times that of 2 grey levels


def test_every_pixel_of_a_whole_screen_is_decoded() -> None:
    plan = FringePlan(Screen(560, 420, SCREEN.pitch), 20.0)
    decoded = decode(CAMERA, plan)
    assert decoded.counts()[PixelReason.DECODED] == CAMERA.width * CAMERA.height
    assert np.isfinite(decoded.place).all()


def test_no_point_is_averaged_over_pixels_beyond_the_border() -> None:
    """With 3x3 pixels a point, the last column and row of this picture are in no whole square."""
    camera = replace(SMALL, width=83, height=62)
    points = screen_points(decode(camera))
    assert points.pixels.max(0).tolist() == [79.0, 58.0]
    errors = place_errors(points, camera, SCREEN)
    assert np.abs(errors.pixels).max() < 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class TiltedCamera(ScreenCamera):
    """A camera that sees the screen tilted by 45 degrees, as if from 640 px away."""

    def homography(self, screen: Screen) -> Floats:
        middle = np.eye(3)
        middle[:2, 2] = -(self.width - 1) / 2, -(self.height - 1) / 2
        tilt = np.eye(3)
        tilt[2, 0] = 1 / 640
        facing = ScreenCamera.homography(self, screen)
        return np.asarray(facing @ np.linalg.inv(middle) @ tilt @ middle)


@pytest.mark.slow
def test_blur_does_not_shift_the_places_of_a_tilted_screen() -> None:
    """A blur mixes more of the screen's far side than of its near side into each pixel, and fringes
    that are too short for the blur show the opposite. Uncorrected, both shift whole parts of the
    picture, by 0.004 and 0.014 px here; the mean noise of a part is 0.0003 px.
    """
    camera = TiltedCamera(width=160, height=120, noise=1.0, jpeg=None)
    for period in (14.0, 30.0):
        points = screen_points(decode(camera, replace(PLAN, period=period)))
        errors = place_errors(points, camera, SCREEN)
        for low in (0, 50, 100):
            columns = (points.pixels[:, 0] >= low) & (points.pixels[:, 0] < low + 60)
            assert np.abs(errors.pixels[columns].mean(0)).max() < 0.001, (period, low)


@pytest.mark.parametrize(
    ("camera", "reason"),
    [
        (replace(SMALL, white=320.0), PixelReason.SATURATED),
        (replace(SMALL, white=18.0), PixelReason.DARK),
        (replace(SMALL, blur=6.0), PixelReason.DEFOCUSED),
        (replace(SMALL, scale=0.4, gap=0.25, blur=0.3), PixelReason.MOIRE),
        (replace(SMALL, scale=0.7, gap=0.25, blur=0.3), PixelReason.MOIRE),
    ],
    ids=["saturated", "dark", "blurred", "pixels", "beat"],
)
def test_a_pixel_without_a_place_has_a_reason(camera: ScreenCamera, reason: PixelReason) -> None:
    counts = decode(camera).counts()
    assert counts[reason] > 0.5 * SMALL.width * SMALL.height
    assert counts[PixelReason.DECODED] == 0


def test_fringes_of_three_camera_pixels_beat() -> None:
    camera = replace(SMALL, blur=0.3)
    plan = replace(PLAN, period=5.5)
    decoded = decode_fringes(camera.photograph(SCREEN, plan.draw()), plan, average=1)
    counts = decoded.counts()
    assert counts[PixelReason.MOIRE] > 0.9 * SMALL.width * SMALL.height


def _half_hidden() -> NDArray[np.bool_]:
    hidden = np.zeros((CAMERA.height, CAMERA.width), bool)
    hidden[40:90, 60:110] = True
    return hidden


def test_pixels_at_an_edge_are_mixed_and_all_others_are_right() -> None:
    hidden = _half_hidden()
    decoded = decode_fringes(CAMERA.photograph(SCREEN, PLAN.draw(), cover=hidden), PLAN)
    assert (decoded.reason[45:85, 65:105] == PixelReason.DARK).all()
    edge = decoded.reason[38:42, 62:108]
    assert np.isin(edge, (PixelReason.DARK, PixelReason.MIXED)).all()
    assert (edge == PixelReason.MIXED).any()
    errors = place_errors(screen_points(decoded), CAMERA, SCREEN)
    assert errors.rms_px < 0.02
    assert np.linalg.norm(errors.pixels, axis=1).max() < 0.06  # five of its standard deviations


def test_the_edge_of_the_screen_is_mixed() -> None:
    camera = replace(CAMERA, scale=3.2)
    decoded = decode(camera, replace(PLAN, period=30.0))
    counts = decoded.counts()
    assert (
        min(counts[PixelReason.DARK], counts[PixelReason.MIXED], counts[PixelReason.DECODED]) > 500
    )
    errors = place_errors(screen_points(decoded), camera, SCREEN)
    assert np.linalg.norm(errors.pixels, axis=1).max() < 0.06


def test_a_reflection_of_another_place_is_mixed() -> None:
    """A pixel that sees 20 % of the light of another place has fringes that contradict each
    other.
    """
    camera = replace(CAMERA, white=180.0, jpeg=None)
    straight = camera.photograph(SCREEN, PLAN.draw())
    mirrored = [frame[:, ::-1] for frame in straight]
    pictures = [
        np.rint(0.8 * frame + 0.2 * other).astype(np.uint8)
        for frame, other in zip(straight, mirrored, strict=True)
    ]
    half = slice(100, None)  # reflected there only: the noise is told by the others
    for picture, frame in zip(pictures, straight, strict=True):
        picture[:, : half.start] = frame[:, : half.start]
    decoded = decode_fringes(pictures, PLAN)
    assert (decoded.reason[:, half.start + 16 :] == PixelReason.MIXED).mean() > 0.9
    assert (decoded.reason[:, : half.start - 16] == PixelReason.DECODED).mean() > 0.9


def test_a_plan_that_cannot_be_decoded_is_refused() -> None:
    with pytest.raises(InputError, match="3 phase steps leave the screen's gamma"):
        FringePlan(SCREEN, 20.0, steps=3)
    with pytest.raises(InputError, match=r"A fringe of 2 screen pixels .*: take 4 to 80\."):
        FringePlan(SCREEN, 2.0)


def test_pictures_of_another_plan_are_refused() -> None:
    picture = np.zeros((12, 16), np.uint8)
    with pytest.raises(InputError, match="3 pictures of fringes where the plan shows 32"):
        decode_fringes([picture] * 3, PLAN)
    with pytest.raises(InputError, match="differ in size or have colours"):
        decode_fringes([picture] * 31 + [picture.T], PLAN)
