"""The predicted colour fringes of a calibration: a sentence each, and the JSON of `calib fit`."""

from collections.abc import Iterator, Sequence

import numpy as np

from calib.apply.colour import ColourFringes
from calib.session.dispersion import WAVELENGTHS_NM


def fringes_lines(fringes: Sequence[ColourFringes]) -> Iterator[str]:
    """Yield a sentence for each depth."""
    for fringe in fringes:
        largest, x, y = fringe.largest
        yield (
            f"Colour fringes at {fringe.depth:g} m: red is {fringe.rms:.2f} px from blue (RMS over"
            f" the picture), and {largest:.2f} px at ({x:.0f}, {y:.0f})."
        )
    if fringes:
        yield "calib undistort --colour removes them."


def fringes_mapping(fringes: Sequence[ColourFringes]) -> dict[str, object]:
    """Return the entry of the JSON object; nothing without fringes."""
    if not fringes:
        return {}
    return {
        "colour": {
            "wavelengths_nm": dict(WAVELENGTHS_NM),
            "fringes": [_mapping(fringe) for fringe in fringes],
        }
    }


def _mapping(fringe: ColourFringes) -> dict[str, object]:
    largest, x, y = fringe.largest
    shift = np.where(np.isfinite(fringe.shift), fringe.shift, None)  # type: ignore[call-overload]
    return {
        "depth_m": fringe.depth,
        "rms_px": fringe.rms,
        "largest_px": largest,
        "largest_at_px": [x, y],
        "columns_px": fringe.columns.tolist(),
        "rows_px": fringe.rows.tolist(),
        "red_from_blue_px": shift.tolist(),
    }
