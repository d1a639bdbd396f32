"""The distance from pixel to pixel of a screen, from a real ruler or a bank card before it."""

from calib.errors import InputError
from calib.session.point_target import PITCH
from calib.session.schema import Number

CARD_MM = (85.60, 53.98)
"""mm, width and height of a card of the size ID-1 (ISO/IEC 7810)."""
CARD_SIGMA_MM = 0.3
"""mm: each of two edges is set to 0.2 mm by eye, and the standard allows cards 0.13 mm."""
RULER_SIGMA_MM = 0.4
"""mm: each of two ends is read to half a millimetre, which is evenly spread."""
KNOWN_SIGMA = 1e-3
"""The relative sigma of a pitch from the screen's data sheet."""
MAX_DEVIATION = 4.0
"""Standard deviations between width and height, above which one of them was measured wrongly: the
pixels of screens are square.
"""


def pitch_of_card(px: tuple[float, float]) -> Number:
    """Return the pitch in m of a screen on which a card is as wide and as high as these pixels."""
    return _pitch(px, CARD_MM, CARD_SIGMA_MM)


def pitch_of_rulers(px: tuple[float, float], mm: tuple[float, float]) -> Number:
    """Return the pitch in m of a screen on which lines of these pixels, one across and one down,
    are so long.
    """
    return _pitch(px, mm, RULER_SIGMA_MM)


def known_pitch(mm: float) -> Number:
    """Return the pitch in m of a screen from its data sheet.

    Raises:
        InputError: no screen has such a pitch.
    """
    if not PITCH.low <= mm <= PITCH.high:
        raise InputError(
            f"A pitch of {mm:g} mm is no screen's: give the millimetres from pixel to pixel, such"
            " as 0.1794, from its width in mm over its pixels."
        )
    return Number(mm / 1000, KNOWN_SIGMA * mm / 1000)


def _pitch(px: tuple[float, float], mm: tuple[float, float], sigma_mm: float) -> Number:
    if not (min(px) > 0 and min(mm) > 0):
        raise InputError("Type both lengths in millimetres, as numbers above 0, such as 203.5.")
    pitches = mm[0] / px[0], mm[1] / px[1]  # mm
    sigmas = sigma_mm / px[0], sigma_mm / px[1]
    if abs(pitches[0] - pitches[1]) > MAX_DEVIATION * (sigmas[0] ** 2 + sigmas[1] ** 2) ** 0.5:
        percent = 100 * abs(pitches[0] / pitches[1] - 1)
        raise InputError(
            f"Width and height differ by {percent:.1f} %, where a screen's pixels are square:"
            " measure both again, in millimetres."
        )
    weights = 1 / sigmas[0] ** 2, 1 / sigmas[1] ** 2
    value = (weights[0] * pitches[0] + weights[1] * pitches[1]) / sum(weights)
    pitch = known_pitch(value).value
    return Number(pitch, sum(weights) ** -0.5 / 1000)
