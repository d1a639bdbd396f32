"""The corners and views that all figures of a report share."""

import numpy as np
from numpy.typing import NDArray

from calib.report.evidence import Array, Evidence
from calib.report.payload import Data

MAX_CORNERS = 4000
"""Corners that the figures show. Of more, they show every second, third ... one."""
SATURATION, VALUE = 0.72, 0.86
"""Saturation and value of the views' colours, which are visible on light and on dark."""


def shown_corners(evidence: Evidence) -> NDArray[np.int64]:
    """Return (N,) the corners that the figures show."""
    return np.arange(0, len(evidence.pixels), corner_step(evidence))


def corner_step(evidence: Evidence) -> int:
    """Return 1 if the figures show every corner, 2 if they show every second one, and so on."""
    return -(-len(evidence.pixels) // MAX_CORNERS)


def corners_data(evidence: Evidence) -> Data:
    """Return the shown corners: their views and numbers on the board, px, errors in px, and
    distances in m.
    """
    rows = shown_corners(evidence)
    return {
        "view": evidence.view[rows],
        "corner": evidence.corner[rows],
        "pixel": evidence.pixels[rows],
        "error": evidence.errors[rows],
        "distance": evidence.distance[rows],
        "step": corner_step(evidence),
    }


def views_data(evidence: Evidence) -> Data:
    """Return the names, errors and colours of the views, and their boards' poses."""
    calibration = evidence.calibration
    colours = (255 * hues(len(calibration.views))).astype(np.int64)
    return {
        "name": [view.name for view in calibration.views],
        "error": evidence.rms_by_view,
        "colour": [f"rgb({red},{green},{blue})" for red, green, blue in colours.tolist()],
        "pose": calibration.poses[:, :6],
    }


def hues(count: int) -> Array:
    """Return (count, 3) colours around the wheel, 0 to 1."""
    sector = 6 * np.linspace(0, 1, count, endpoint=False)[:, None]
    red_green_blue = np.abs((sector + np.array([0, 4, 2])) % 6 - 3) - 1
    return np.asarray(VALUE * (1 - SATURATION * (1 - red_green_blue.clip(0, 1))))
