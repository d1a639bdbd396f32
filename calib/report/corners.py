"""The corners and views that all figures of a report share."""

import numpy as np
from numpy.typing import NDArray

from calib.report.evidence import Array, Evidence
from calib.report.payload import Data

MAX_CORNERS = 4000
"""Corners that the figures show. Of more, they show every second, third ... one."""


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
    """Return the names and errors of the views, and their boards' poses."""
    calibration = evidence.calibration
    return {
        "name": [view.name for view in calibration.views],
        "error": evidence.rms_by_view,
        "pose": calibration.poses[:, :6],
    }


def relative_errors(evidence: Evidence) -> Array:
    """Return (V,) the error of each view, from 0 for the smallest to 1 for the largest."""
    errors = evidence.rms_by_view
    span = float(np.ptp(errors)) or 1.0
    return np.asarray((errors - errors.min()) / span)
