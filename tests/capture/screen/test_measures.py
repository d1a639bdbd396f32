"""The size of a pixel, the lag and flicker of a screen, its motion, and the best fringes."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from calib.errors import InputError
from calib.fringes.decode import PixelReason, decode_fringes
from calib.fringes.pattern import WHITE, FringePlan, Screen
from capture.screen.aim import next_stance
from capture.screen.motion import measure_motion
from capture.screen.period import (
    FringeTrial,
    best_period,
    judge_trial,
    reference_pattern,
    trial_pattern,
    trial_periods,
)
from capture.screen.pitch import known_pitch, pitch_of_card, pitch_of_rulers
from capture.screen.pose import MAX_TORN, loss_sentence
from capture.screen.timing import lit_pixels, measure_timing, timing_sentences
from capture.screen.torn import torn_share
from fixtures.screen import ScreenCamera

SCREEN = Screen(420, 320, (2e-4, 2e-4))
CAMERA = ScreenCamera(width=80, height=60, jpeg=None)
ALL = np.ones((60, 80), bool)


def test_rulers_and_a_card_tell_the_pitch_with_its_sigma() -> None:
    ruler = pitch_of_rulers((1536, 756), (275.6, 135.6))
    assert ruler.value == pytest.approx(0.1794e-3, rel=2e-4)
    assert 0.001 < ruler.sigma / ruler.value < 0.002
    card = pitch_of_card((477, 301))
    assert card.value == pytest.approx(0.1794e-3, rel=2e-3)
    assert ruler.sigma < card.sigma < 0.004 * card.value


@pytest.mark.parametrize(
    ("mm", "words"),
    [
        ((275.6, 141.0), "pixels are square"),
        ((275.6, 0.0), "above 0"),
        ((3e6, 1.476e6), "screen's"),
    ],
)
def test_lengths_that_cannot_be_are_one_sentence(mm: tuple[float, float], words: str) -> None:
    with pytest.raises(InputError, match=words):
        pitch_of_rulers((1536, 756), mm)


def test_a_pitch_in_metres_is_refused() -> None:
    with pytest.raises(InputError, match="millimetres"):
        known_pitch(0.0001794)


def frames(levels: list[float], ripple: float = 0.0) -> list[NDArray[np.uint8]]:
    """Return pictures of these levels, whose rows differ from picture to picture by a ripple."""
    rng = np.random.default_rng(1)
    pictures = []
    for number, level in enumerate(levels):
        wave = 1 + ripple * np.sin(2 * np.pi * (np.arange(60) / 40 + number * 0.37))[:, None]
        picture = level * wave + rng.normal(0, 2, (60, 80))
        pictures.append(np.clip(np.rint(picture), 0, 255).astype(np.uint8))
    return pictures


def test_the_lag_is_the_time_until_nothing_changes() -> None:
    times = [0.05 * number for number in range(20)]
    levels = [10.0, 10.0, 90.0, 205.0, *[210.0] * 16]
    timing = measure_timing(frames([10.0])[0], frames(levels), times)
    assert timing.lag_s == pytest.approx(0.2)
    assert timing.flicker < 0.004
    assert len(timing_sentences(timing, 60.0, 16667.0)) == 1


def test_a_flicker_is_told_with_the_exposure_that_ends_it() -> None:
    times = [0.05 * number for number in range(20)]
    timing = measure_timing(frames([10.0])[0], frames([200.0] * 20, 0.05), times)
    assert timing.flicker == pytest.approx(0.05 / 2**0.5, rel=0.1)
    assert "exposure_us=16667" in timing_sentences(timing, 60.0, 8000.0)[1]
    assert "exposure_us" not in timing_sentences(timing, 60.0, 33300.0)[1]


@pytest.mark.parametrize(
    ("levels", "words"),
    [(list(np.linspace(120, 220, 20)), "lock its exposure"), ([11.0] * 20, "does not see")],
    ids=["automatic exposure", "turned away"],
)
def test_a_camera_that_cannot_be_used_is_told(levels: list[float], words: str) -> None:
    times = [0.05 * number for number in range(20)]
    with pytest.raises(InputError, match=words):
        measure_timing(frames([10.0])[0], frames(levels), times)


def test_a_motion_is_measured_to_two_hundredths_of_a_pixel() -> None:
    """In a picture of 80x60 pixels; a larger one tells more."""
    drawing = reference_pattern(*SCREEN.size).draw()
    rng = np.random.default_rng(0)
    first = CAMERA.lit_screen(SCREEN).photograph(drawing, rng)
    second_picture = CAMERA.lit_screen(SCREEN).photograph(drawing, rng)
    assert measure_motion(first, second_picture, ALL) < 0.02
    brighter = np.clip(first * 0.95 + 4, 0, 255).astype(np.uint8)
    assert measure_motion(first, brighter, ALL) < 0.01
    farther = replace(CAMERA, scale=CAMERA.scale * 1.005)
    moved = farther.lit_screen(SCREEN).photograph(drawing, rng)
    v, u = np.indices((60, 80)) - np.array([29.5, 39.5])[:, None, None]
    expected = 0.005 * np.sqrt((u**2 + v**2).mean())
    assert measure_motion(first, moved, ALL) == pytest.approx(expected, rel=0.15)
    elsewhere = np.roll(first, 20, axis=1)
    assert measure_motion(first, elsewhere, ALL) > 0.1


@pytest.mark.parametrize("blur", [1.5, 3.0])
def test_the_best_period_grows_with_the_blur(blur: float) -> None:
    """It is near 2 pi times the blur on the screen, and no shorter than decoding allows."""
    camera = replace(CAMERA, blur=blur)
    lit = camera.lit_screen(SCREEN)
    rng = np.random.default_rng(0)
    flat = np.zeros((SCREEN.height, SCREEN.width), np.uint8)
    black = lit.photograph(flat, rng)
    white = lit.photograph(flat + np.uint8(255), rng)
    trials = []
    for period in trial_periods(*SCREEN.size):
        picture = lit.photograph(trial_pattern(period, *SCREEN.size).draw(), rng)
        trials.append(judge_trial(period, black, white, picture, ALL))
    coarsest = trials[0]
    assert coarsest.camera_period == pytest.approx(coarsest.period / camera.scale, rel=0.2)
    best = best_period(trials)
    assert best
    assert 0.65 < best / (2 * np.pi * blur * camera.scale) < 1.5


def test_no_period_is_best_where_no_fringe_is_seen() -> None:
    assert best_period([FringeTrial(20.0, 0.1, 10.0), FringeTrial(14.0, 0.9, 3.0)]) is None


def test_the_next_stance_names_the_part_that_has_no_points() -> None:
    assert "over" not in next_stance((), 640, 480, 0)
    v, u = np.indices((480, 640))[:, ::5, ::5].reshape(2, -1)
    pixels = np.column_stack([u, v]).astype(np.float64)
    corner = pixels[~((u > 430) & (v > 320))]
    assert "bottom right" in next_stance([corner], 640, 480, 1)
    assert "over" not in next_stance([pixels, pixels], 640, 480, 2)


def test_a_picture_of_two_patterns_is_torn() -> None:
    """So is a picture of the pattern before. Gamma, noise and blur are no reason."""
    plan = FringePlan(SCREEN, 20.0)
    flat = np.zeros((SCREEN.height, SCREEN.width), np.uint8)
    for camera in (CAMERA, replace(CAMERA, gamma=2.8, noise=6.0), replace(CAMERA, blur=3.0)):
        black, white = camera.photograph(SCREEN, [flat, flat + np.uint8(WHITE)], seed=9)
        lit = lit_pixels(black, white)
        frames = camera.photograph(SCREEN, plan.draw())
        assert torn_share(frames, plan, black, white, lit) < MAX_TORN / 10
        for number in (1, 2, 9, 20, 31):
            for rows in (slice(None), slice(15)):
                torn = [frame.copy() for frame in frames]
                torn[number][rows] = frames[number - 1][rows]
                share = torn_share(torn, plan, black, white, lit)
                assert share > 2 * MAX_TORN, (number, rows)


def test_a_person_reads_why_a_part_of_the_screen_has_no_points() -> None:
    """The left quarter of the picture is saturated."""
    plan = FringePlan(SCREEN, 20.0)
    frames = CAMERA.photograph(SCREEN, plan.draw())
    assert loss_sentence(decode_fringes(frames, plan), ALL) == ""
    bright = [frame.copy() for frame in frames]
    bright[1][:, :20] = WHITE
    decoded = decode_fringes(bright, plan)
    assert decoded.counts()[PixelReason.DECODED] > 0.5 * ALL.size
    sentence = loss_sentence(decoded, ALL)
    assert "% of the screen has no points: shorten the exposure" in sentence
