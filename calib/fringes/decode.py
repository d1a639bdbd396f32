"""Decode pictures of fringes: the place on the screen that each camera pixel sees, or the reason
why it has none.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.errors import InputError
from calib.fringes.pattern import FringePlan, Unwrapping

Floats = NDArray[np.float64]

AVERAGE = 3
"""px, the side of the window over which levels are averaged by default. It costs less contrast than
a blur of 1 px, and noise falls to a third.
"""
SATURATED_LEVEL = 254
"""A camera's level from which its light is no longer told."""
MIN_CONTRAST = 8.0
"""Grey levels between white and black, below which a pixel does not see the screen."""
MIN_MODULATION = 0.1
"""The amplitude of the fringes over half of the contrast, below which they are too blurred."""
MIN_CAMERA_PERIOD = 4.0
"""Camera pixels in a fringe. A fringe of fewer beats with the camera's pixels."""
MAX_RIPPLE = 0.03
"""The ripple of the white screen over its contrast, from which the grid of its pixels beats with
the camera's.
"""
RIPPLE_REACH = 9
"""px, the width of the window in which a ripple is measured."""
NOISE_REACH = 31
"""px, the width of the window in which noise is measured: four numbers in each of its pixels."""
MIN_EDGE_CONTRAST = 0.9
"""The contrast over the largest one nearby, below which a pixel sees something else as well."""
EDGE_REACH = 11
"""px, the width of the window of that largest contrast."""
MAX_PHASE_DEVIATION = 5.0
"""Standard deviations by which the fringes of one pixel may contradict each other (root mean
square): 4 numbers of Gaussian noise exceed it once in 10^20.
"""
EDGE_BLURS = 3.5
"""The blur (standard deviation) times this is the margin at edges: the mean place of the light that
a pixel keeps is off by less than a thousandth of the blur.
"""
SLOPE_REACH = 7
"""px, the width of the window over which places are averaged before their slopes are taken."""
CURVATURE_REACH = 15
"""px, the width of the windows in which the curvature of places is measured."""
HARMONIC_MODULATION = 0.99
"""The amplitude of unblurred fringes over half of the contrast: 1 at a gamma of 1, 0.99 at 2.2 and
0.97 at 2.5.
"""


class PixelReason(IntEnum):
    """A pixel's state after decoding."""

    DECODED = 0
    DARK = 1
    """The pixel does not see the screen."""
    SATURATED = 2
    DEFOCUSED = 3
    """The fringes are too blurred."""
    MOIRE = 4
    """The screen's pixels or fringes beat with the camera's pixels."""
    MIXED = 5
    """The pixel sees two places of the screen, or an edge of the screen or of something before
    it.
    """


@dataclass(frozen=True, slots=True, eq=False)
class DecodedScreen:
    """The places on the screen that the pixels of a (H, W) picture see."""

    place: Floats
    """(H, W, 2) m in the screen's frame, NaN where not decoded."""
    covariance: Floats
    """(H, W, 2, 2) m^2, from the fringes' amplitude and noise; NaN where not decoded."""
    reason: NDArray[np.uint8]
    """(H, W) a `PixelReason` for each pixel."""
    noise: Floats
    """(H, W) grey levels, the standard deviation of one averaged picture around each pixel."""
    average: int
    """px, the distance between pixels that share no light."""

    def counts(self) -> dict[PixelReason, int]:
        """Return the number of pixels for each reason."""
        return {reason: int(np.count_nonzero(self.reason == reason)) for reason in PixelReason}


@dataclass(frozen=True, slots=True, eq=False)
class ScreenPoints:
    """Camera pixels and the points on the screen that they see."""

    pixels: Floats
    """(N, 2) px"""
    target: Floats
    """(N, 3) m in the screen's frame; z is 0."""
    covariance: Floats
    """(N, 2, 2) px^2"""


@dataclass(frozen=True, slots=True, eq=False)
class _Axis:
    """One axis of all pixels."""

    place: Floats
    """(H, W) screen pixels from the middle."""
    gain: Floats
    """(H, W) screen pixels^2 of variance per squared grey level of noise."""
    amplitude: Floats
    """(H, W) grey levels, the smallest of the frequencies."""
    misfit: Floats
    """(H, W) squared grey levels: the sum of squares of the residual phases' amplitudes."""
    freedom: int
    """Residual degrees of freedom of each pixel."""


def decode_fringes(
    frames: Sequence[NDArray[np.uint8]], plan: FringePlan, average: int = AVERAGE
) -> DecodedScreen:
    """Decode the pictures of a plan, in the order of `FringePlan.draw`.

    Args:
        frames: (H, W) grey pictures of a camera and a screen that stand still. The camera's light
            is constant, its levels are those of the sensor or of a smooth curve.
        average: px, odd: the side of the window over which levels are averaged. 1: none.

    Raises:
        InputError: there are too many or too few pictures, or their sizes differ.
    """
    if len(frames) != plan.count:
        raise InputError(
            f"{len(frames)} pictures of fringes where the plan shows {plan.count}: give one for"
            " each, black and white first."
        )
    shapes = {frame.shape for frame in frames}
    if len(shapes) > 1 or len(frames[0].shape) != 2:
        raise InputError(
            "The pictures of fringes differ in size or have colours: give grey pictures of one"
            " size."
        )
    saturated = np.max(frames, axis=0) >= SATURATED_LEVEL
    window = (average, average)
    levels = [_box_mean(frame.astype(np.float64), average) for frame in frames]
    black = levels[0]
    contrast = levels[1] - black
    per_axis = [plan.steps * len(plan.fringes(axis)) + plan.bits(axis) for axis in (0, 1)]
    x_frames = levels[2 : 2 + per_axis[0]]
    y_frames = levels[2 + per_axis[0] :]
    x = _decode_axis(x_frames, plan, 0, black + contrast / 2)
    y = _decode_axis(y_frames, plan, 1, black + contrast / 2)

    smooth = _box_mean(contrast, 3)
    lit = smooth >= MIN_CONTRAST
    amplitude = np.minimum(x.amplitude, y.amplitude)
    modulation = np.where(lit, 2 * amplitude / np.where(lit, smooth, 1), 0)
    saturated = cv2.dilate(saturated.astype(np.uint8), np.ones(window, np.uint8)) > 0
    defocused = modulation < MIN_MODULATION
    usable = lit & ~saturated & ~defocused
    noise = _local_noise(x, y, usable)
    place = np.stack([x.place, y.place], -1)
    slopes = _slopes(place, usable)
    moire = _ripples(frames[1].astype(np.float64) - frames[0], smooth, usable, noise * average)
    moire |= _has_short_fringes(slopes, plan)
    misfit = x.misfit + y.misfit
    freedom = x.freedom + y.freedom
    contradicted = misfit > MAX_PHASE_DEVIATION**2 * freedom * noise**2
    off_screen = (2 * np.abs(place) > plan.screen.size).any(-1)
    attenuation = np.stack([_attenuation(axis.amplitude, smooth, lit) for axis in (x, y)], -1)
    blur = _blur_variance(attenuation, usable & ~moire, slopes, plan)
    margin = _edge_margin(blur)
    edge = smooth < MIN_EDGE_CONTRAST * cv2.dilate(smooth, np.ones((EDGE_REACH, EDGE_REACH)))
    reach = np.ones((2 * margin + 1, 2 * margin + 1), np.uint8)
    mixed = cv2.dilate((edge | ~lit | off_screen).astype(np.uint8), reach) > 0
    near = np.ones((3, 3), np.uint8)
    contradicted = cv2.dilate((contradicted & usable).astype(np.uint8), near) > 0
    reason = np.select(
        [~lit, saturated, defocused, mixed, moire, contradicted],
        [
            PixelReason.DARK,
            PixelReason.SATURATED,
            PixelReason.DEFOCUSED,
            PixelReason.MIXED,
            PixelReason.MOIRE,
            PixelReason.MIXED,
        ],
        PixelReason.DECODED,
    )
    decoded = reason == PixelReason.DECODED
    place = place - _curvature_bias(place, blur, decoded & _is_inside(decoded.shape, average), plan)
    pitch = np.array(plan.screen.pitch)
    variance = np.stack([x.gain, y.gain], -1) * (noise**2)[..., None] * pitch**2
    return DecodedScreen(
        place=np.where(decoded[..., None], place * pitch, np.nan),
        covariance=np.where(decoded[..., None, None], variance[..., None] * np.eye(2), np.nan),
        reason=reason.astype(np.uint8),
        noise=noise,
        average=average,
    )


def screen_points(decoded: DecodedScreen) -> ScreenPoints:
    """Return the decoded pixels as points, with the covariance of each as if the point were exact
    and the pixel uncertain. The pixels are as far from each other as needed to share no light. One
    whose neighbours do not tell the slopes is left out, and one whose average reaches beyond the
    picture's border.
    """
    valid = decoded.reason == PixelReason.DECODED
    slopes = _slopes(decoded.place, valid)
    determinant = np.linalg.det(np.where(np.isfinite(slopes), slopes, 0))
    valid &= np.isfinite(slopes).all((-1, -2)) & (determinant != 0)
    middle = decoded.average // 2
    sampled = np.zeros_like(valid)
    sampled[middle :: decoded.average, middle :: decoded.average] = True
    valid &= sampled & _is_inside(valid.shape, decoded.average)
    rows, columns = np.nonzero(valid)
    place = decoded.place[valid]
    inverse = np.linalg.inv(slopes[valid])
    return ScreenPoints(
        pixels=np.column_stack([columns, rows]).astype(np.float64),
        target=np.column_stack([place, np.zeros(len(place))]),
        covariance=inverse @ decoded.covariance[valid] @ inverse.swapaxes(-1, -2),
    )


def _is_inside(shape: tuple[int, ...], average: int) -> NDArray[np.bool_]:
    """Return (H, W) true where a pixel's average does not reach beyond the picture's border."""
    reach = average // 2
    mask = np.zeros(shape, np.bool_)
    mask[reach : shape[0] - reach, reach : shape[1] - reach] = True
    return mask


def _decode_axis(frames: Sequence[Floats], plan: FringePlan, axis: int, middle: Floats) -> _Axis:
    """Decode the pictures of an axis. `middle` (H, W) is the level between black and white."""
    fringes = plan.fringes(axis)
    extent = plan.extent(axis)
    weights = np.exp(2j * np.pi * np.arange(plan.steps) / plan.steps) * 2 / plan.steps
    phasors = []
    for first in range(0, plan.steps * len(fringes), plan.steps):
        series = frames[first : first + plan.steps]
        phasors.append(sum(w * frame for w, frame in zip(weights, series, strict=True)))
    amplitudes = np.abs(phasors)
    turns = np.angle(phasors) / (2 * np.pi) % 1  # of a fringe
    if plan.unwrapping == Unwrapping.GRAY:
        bits = [frame > middle for frame in frames[plan.steps * len(fringes) :]]
        rough = (_gray_number(bits) + 0.5) / (2 * fringes[0])
    else:
        beat = fringes[0] - fringes[1]
        rough = (turns[0] - turns[1]) % 1 / beat
        rough = _nearest(rough, turns[0] - turns[2], fringes[0] - fringes[2])
    places = np.array([_nearest(rough, turns[0], fringes[0])])
    for turn, number in zip(turns[1:], fringes[1:], strict=True):
        places = np.concatenate([places, _nearest(places[0], turn, number)[None]])
    # A phase has the variance 2 / (N amplitude^2) per squared grey level.
    slopes = 2 * np.pi * np.array(fringes)[:, None, None]
    information = plan.steps / 2 * (amplitudes * slopes) ** 2
    total = np.maximum(information.sum(0), 1e-300)
    place = (information * places).sum(0) / total
    return _Axis(
        place=(place - 0.5) * extent,
        gain=extent**2 / total,
        amplitude=amplitudes.min(0),
        misfit=(information * (places - place) ** 2).sum(0),
        freedom=len(fringes) - 1,
    )


def _nearest(rough: Floats, turns: Floats, number: int) -> Floats:
    """Return the place (of the extent) nearest to `rough` at which `number` fringes show `turns`
    of a fringe.
    """
    return np.asarray((np.rint(rough * number - turns) + turns) / number)


def _gray_number(bits: Sequence[NDArray[np.bool_]]) -> Floats:
    """Return the numbers whose Gray code the bits are, the highest bit first."""
    digit = np.zeros(bits[0].shape, bool)
    number = np.zeros(bits[0].shape)
    for bit in bits:
        digit = digit ^ bit
        number = 2 * number + digit
    return number


def _local_noise(x: _Axis, y: _Axis, usable: NDArray[np.bool_]) -> Floats:
    """Return (H, W) grey levels: the noise of one picture, from how far the fringes of the pixels
    around contradict each other.
    """
    freedom = x.freedom + y.freedom
    misfit = np.where(usable, x.misfit + y.misfit, 0)
    # Fringes that were counted wrongly are mixed pixels, not noise.
    ceiling = MAX_PHASE_DEVIATION**2 * np.median(misfit[usable]) if usable.any() else 0.0
    quiet = usable & (misfit <= ceiling)
    counts = _box_mean(quiet.astype(np.float64), NOISE_REACH)
    energy = _box_mean(np.where(quiet, misfit, 0.0), NOISE_REACH)
    everywhere = misfit[quiet].mean() if quiet.any() else freedom
    variance = np.where(counts > 0.05, energy / np.maximum(counts, 0.05), everywhere) / freedom
    return np.sqrt(np.maximum(variance, 1e-12))


def _slopes(place: Floats, valid: NDArray[np.bool_], reach: int = SLOPE_REACH) -> Floats:
    """Return the (H, W, 2, 2) derivatives of places by the pixel, from averages over valid pixels;
    NaN where there are none.
    """
    shares = _box_mean(valid.astype(np.float64), reach)
    grid = np.indices(valid.shape).astype(np.float64)
    rows: Floats = grid[0]
    columns: Floats = grid[1]

    def mean(values: Floats) -> Floats:
        sums = _box_mean(np.where(valid, values, 0.0), reach)
        return np.where(shares > 0.2, sums / np.maximum(shares, 0.2), np.nan)

    # Least squares of a plane in each window.
    u, v = mean(columns), mean(rows)
    uu = mean(columns**2) - u * u
    vv = mean(rows**2) - v * v
    uv = mean(columns * rows) - u * v
    determinant = uu * vv - uv * uv
    determinant = np.where(determinant > 0.1, determinant, np.nan)
    slopes = np.empty((*valid.shape, 2, 2))
    for i in (0, 1):
        w = np.where(valid, place[..., i], 0)
        centre = mean(w)
        uw, vw = mean(columns * w) - u * centre, mean(rows * w) - v * centre
        slopes[..., i, 0] = (vv * uw - uv * vw) / determinant
        slopes[..., i, 1] = (uu * vw - uv * uw) / determinant
    return slopes


def _box_mean(values: Floats, size: int) -> Floats:
    """Return the (H, W) means over windows of `size` px."""
    return np.asarray(cv2.blur(values, (size, size)), np.float64)


def _camera_periods(slopes: Floats, plan: FringePlan) -> Floats:
    """Return (H, W, 2) camera pixels in the finest fringe along x and along y."""
    lengths = np.linalg.norm(slopes, axis=-1)  # screen pixels in a camera pixel
    finest = [plan.extent(axis) / plan.fringes(axis)[0] for axis in (0, 1)]
    return np.asarray(np.array(finest) / np.maximum(lengths, 1e-9))


def _has_short_fringes(slopes: Floats, plan: FringePlan) -> NDArray[np.bool_]:
    return np.asarray((_camera_periods(slopes, plan) < MIN_CAMERA_PERIOD).any(-1))


def _ripples(
    contrast: Floats, smooth: Floats, usable: NDArray[np.bool_], noise: Floats
) -> NDArray[np.bool_]:
    """Return (H, W) true where the white screen has a ripple that neither noise nor an edge
    explains.
    """
    window = (RIPPLE_REACH, RIPPLE_REACH)
    mean = _box_mean(contrast, RIPPLE_REACH)
    variance = np.maximum(_box_mean(contrast**2, RIPPLE_REACH) - mean**2, 0)
    inner = cv2.erode(usable.astype(np.uint8), np.ones(window, np.uint8)) > 0
    level = np.maximum(smooth, MIN_CONTRAST)
    # White and black have the noise of a picture each; a window's own scatter is added to it.
    floor = 2 * noise**2 * (1 + 4 * np.sqrt(2) / RIPPLE_REACH)
    return np.asarray(inner & (variance > floor + (MAX_RIPPLE * level) ** 2))


def _attenuation(amplitude: Floats, contrast: Floats, lit: NDArray[np.bool_]) -> Floats:
    """Return (H, W) the amplitude of the fringes of an axis over that of unblurred ones."""
    unblurred = HARMONIC_MODULATION * np.where(lit, contrast, np.inf) / 2
    return np.asarray(np.clip(amplitude / unblurred, 1e-6, 1.0))


def _blur_variance(
    attenuation: Floats, usable: NDArray[np.bool_], slopes: Floats, plan: FringePlan
) -> Floats:
    """Return (H, W) px^2, the variance of the blur around each pixel, from the (H, W, 2)
    attenuation of the fringes: a Gaussian blur leaves exp(-variance frequency^2 / 2).
    """
    frequency = 2 * np.pi / _camera_periods(slopes, plan)
    valid = usable & np.isfinite(frequency).all(-1)
    losses = np.where(valid, -2 * np.log(attenuation).sum(-1), 0.0)
    squares = np.where(valid, (frequency**2).sum(-1), 0.0)
    if not valid.any():
        return np.zeros(usable.shape)
    everywhere = losses.sum() / squares.sum()
    enough = _box_mean(valid.astype(np.float64), NOISE_REACH) > 0.05
    total = np.where(enough, _box_mean(squares, NOISE_REACH), 1.0)
    return np.where(enough, _box_mean(losses, NOISE_REACH) / total, everywhere)


def _curvature_bias(
    place: Floats, blur: Floats, valid: NDArray[np.bool_], plan: FringePlan
) -> Floats:
    """Return the (H, W, 2) screen pixels by which blurred places are off where they are curved, as
    on a tilted screen; 0 where there are too few valid pixels.

    A blur of variance s averages the fringes' light over places x + g u + u H u / 2. To first order
    in the curvature H, this moves fringes of frequency k by s (tr H - s k^2 g H g) / 2.
    """
    bias = np.zeros_like(place)
    slopes = _slopes(place, valid, CURVATURE_REACH)
    for axis in (0, 1):
        slope = slopes[..., axis, :]
        curvature = _slopes(slope, valid & np.isfinite(slope).all(-1), CURVATURE_REACH)
        fringes = np.array(plan.fringes(axis))
        frequency2 = np.mean((2 * np.pi * fringes / plan.extent(axis)) ** 2)
        cross = np.einsum("hwi,hwij,hwj->hw", slope, curvature, slope)
        trace = curvature[..., 0, 0] + curvature[..., 1, 1]
        bias[..., axis] = blur / 2 * (trace - blur * frequency2 * cross)
    return np.nan_to_num(bias)


def _edge_margin(blur: Floats) -> int:
    """Return the px at an edge of which the blur makes mixed pixels, for its (H, W) px^2."""
    return 1 + int(np.ceil(EDGE_BLURS * np.sqrt(np.median(blur))))
