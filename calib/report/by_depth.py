"""Figure: distortion against inverse depth (the paper's Fig. 8), and its slope over the image."""

import numpy as np

from calib.report.displacement import Displacement, lattice
from calib.report.distortion import NODES
from calib.report.evidence import Array, Evidence
from calib.report.figure import Drawing

REACH = (0.5, 10.0)
"""The range of the paper's Fig. 8 in 1/m; the training depths may extend it."""
SAMPLES = 40
CHOSEN = {"●": (0.5, 0.5), "■": (0.25, 0.5), "▲": (0.125, 0.5), "◆": (0.02, 0.02)}
"""Marks of the four pixels whose lines are drawn, as fractions of the image: the centre, the two of
the paper, and a corner.
"""


def chosen_pixels(evidence: Evidence) -> Array:
    """Return the (4, 2) px of CHOSEN."""
    camera = evidence.calibration.camera
    return np.array(list(CHOSEN.values())) * [camera.width - 1, camera.height - 1]


def inverse_depths(evidence: Evidence) -> Array:
    """Return (SAMPLES,) 1/m, for the axis of the figure."""
    near, far = evidence.reach
    return np.linspace(min(REACH[0], 1 / far), max(REACH[1], 1 / near), SAMPLES)


def lengths_by_depth(displacement: Displacement, inverse: Array) -> Array:
    """Return (D, ...) px: the lengths at (D,) inverse depths, 1/m."""
    return np.array([np.linalg.norm(displacement.at(1 / depth), axis=-1) for depth in inverse])


def distortion_by_depth(evidence: Evidence) -> Drawing | None:
    """Return None for a central camera, whose distortion does not depend on depth."""
    if evidence.path.central:
        return None
    pixels = chosen_pixels(evidence)
    inverse = inverse_depths(evidence)
    x, y, displacement = lattice(evidence, NODES)
    change = np.linalg.norm(displacement.parallax, axis=-1)
    near, far = evidence.reach
    return Drawing(
        "by-depth",
        "The distortion by inverse depth",
        "The lines are the length of the distortion at four pixels, and its mean. Each number is"
        " the change from the left to the right end of the axis. Shaded: the depths of the corners."
        " The picture marks the four pixels, and shows how far the undistorted pixel moves when"
        " 1/depth changes by 1 per metre. Where this is large, a map needs the right depth.",
        {
            "x": x,
            "y": y,
            "change": change,
            "marks": list(CHOSEN),
            "pixels": pixels,
            "inverse": inverse,
            "lengths": lengths_by_depth(Displacement.of(evidence, pixels), inverse).T,
            "mean": np.nanmean(lengths_by_depth(displacement, inverse), (1, 2)),
            "trained": [1 / far, 1 / near],
        },
    )
