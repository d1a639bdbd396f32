"""Figure: the distortion over the image, with contours (the paper's Fig. 7), and its change
between two depths.
"""

import numpy as np

from calib.report.displacement import lattice
from calib.report.evidence import Evidence
from calib.report.figure import Drawing

NODES = (49, 37)
LEVELS = (0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 25.0, 50.0, 100.0, 250.0, 500.0)
"""Contours in px; 2.5, 5 and 10 are those of the paper."""
MAX_LEVELS = 4
MIN_GROWTH = 0.005
"""The relative magnification below which the caption does not mention it."""


def shown_depths(evidence: Evidence) -> list[float]:
    """Return the depths in m at which the figure begins: the nearest and the farthest one. Of a
    single depth, the second is that end of the corners' range at which the distortion differs more.
    """
    if evidence.path.central:
        return [1.0]
    first, last = evidence.depths[0], evidence.depths[-1]
    if first < last:
        return [first, last]
    ends = [float(f"{depth:.2g}") for depth in evidence.reach]
    other = max(ends, key=lambda depth: abs(1 / depth - 1 / first))
    return sorted({first, other})


def contour_levels(largest: float) -> list[float]:
    """Return the levels in px of contours for a field with this largest length in px."""
    return [level for level in LEVELS if level < largest][-MAX_LEVELS:]


def distortion_caption(evidence: Evidence) -> str:
    depths = shown_depths(evidence)
    return (
        "Undistorted minus distorted pixel, for a scene at one depth. Contours are lines of"
        " equal length. Arrows show the direction; they are scaled until the longest has the same"
        " size in every panel, by the factor above it."
        + (
            " The two maps differ because a cover also shifts rays sideways, which matters more"
            " near the camera. The last panel is their difference: the error of one map, used at"
            " the depth of the other. It has colours of its own."
            if len(depths) == 2
            else ""
        )
        + _magnification(evidence)
        + evidence.limit_caption
    )


def _magnification(evidence: Evidence) -> str:
    """Return a sentence on how much of a cover's distortion at the first depth is a change of
    scale, such as that of water; empty if it is less than half.
    """
    if evidence.path.central:
        return ""
    depth = shown_depths(evidence)[0]
    x, y, displacement = lattice(evidence, NODES)
    field = displacement.at(depth).reshape(-1, 2)
    valid = np.isfinite(field).all(1)
    field = field[valid]
    pixels = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)[valid]
    centred = pixels - pixels.mean(0)
    growth = float((centred * field).sum() / (centred**2).sum())
    rest = field - field.mean(0) - growth * centred
    total = float(np.linalg.norm(field, axis=-1).max())
    bent = float(np.linalg.norm(rest, axis=-1).max())
    if bent >= total / 2 or abs(growth) < MIN_GROWTH:
        return ""
    return (
        f" At {depth:g} m the cover enlarges the picture by a factor of {1 / (1 + growth):.3g}."
        f" Of the largest distortion, {total:.1f} px, all but {bent:.1f} px is this enlargement and"
        " a shift."
    )


def distortion_fields(evidence: Evidence) -> Drawing:
    x, y, displacement = lattice(evidence, NODES)
    depths = shown_depths(evidence)
    largest = max(
        float(np.nanmax(np.linalg.norm(displacement.at(depth), axis=-1))) for depth in depths
    )
    near, far = evidence.reach
    return Drawing(
        "distortion",
        "The distortion over the picture",
        distortion_caption(evidence),
        {
            "x": x,
            "y": y,
            "atInfinity": displacement.at_infinity,
            "parallax": displacement.parallax,
            "central": evidence.path.central,
            "depths": depths,
            "reach": [near, far],
            "largest": largest,
            "levels": contour_levels(largest),
        },
    )
