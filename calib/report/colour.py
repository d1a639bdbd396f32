"""Table of the predicted colour fringes of a cover, by depth and place."""

import numpy as np

from calib.apply.colour import ColourFringes, predict_fringes
from calib.report.evidence import Evidence
from calib.session.dispersion import WAVELENGTHS_NM
from calib.table import html_table

PLACES: dict[str, tuple[float, float]] = {
    "upper left": (0, 0),
    "top": (0, 0.5),
    "upper right": (0, 1),
    "left": (0.5, 0),
    "middle": (0.5, 0.5),
    "right": (0.5, 1),
    "lower left": (1, 0),
    "bottom": (1, 0.5),
    "lower right": (1, 1),
}
"""Places in the picture as fractions of its height and width."""


def fringes_html(evidence: Evidence) -> str:
    """Return the table with a sentence; an empty text without dispersion."""
    fringes = predict_fringes(evidence.calibration, evidence.depths)
    if not fringes:
        return ""
    lights = ", ".join(f"{channel} {nm:g} nm" for channel, nm in WAVELENGTHS_NM.items())
    rows = [
        (
            f"{fringe.depth:.3g} m",
            f"<b>{fringe.rms:.2f}</b>",
            *(_size(fringe, at) for at in PLACES.values()),
        )
        for fringe in fringes
    ]
    return (
        html_table(("depth", "RMS over the picture", *PLACES), rows)
        + f"<p>The distance of red from blue in a picture as it is taken, in px, as the cover's"
        f" dispersion predicts it ({lights}). The lens adds its own, which is not in here."
        " <code>calib undistort --colour</code> removes the cover's.</p>"
    )


def _size(fringe: ColourFringes, place: tuple[float, float]) -> str:
    rows, columns = fringe.size.shape
    size = fringe.size[round(place[0] * (rows - 1)), round(place[1] * (columns - 1))]
    return f"{size:.2f}" if np.isfinite(size) else ""
