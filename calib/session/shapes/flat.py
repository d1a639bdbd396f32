"""A flat window in front of the camera.

A tilt turns it about the point of its inner face on the optical axis, so the distance along that
axis stays.
"""

from calib.session.schema import Quantity
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.shape import ChartAxis, Shape
from calib.session.tolerances import COVER_TILT, DISTANCE, UNKNOWN_DISTANCE, UNKNOWN_TILT

FLAT = Shape(
    "flat",
    "a flat window",
    (
        Dimension(
            Quantity("distance_mm", low=0.05, high=1e5, wide=UNKNOWN_DISTANCE),
            words="the distance of the glass from the pinhole (distance_mm)",
            explanation="Millimetres from the lens to the window's inner face.",
            tolerance=DISTANCE,
            option="distance",
            effect="cover_offset",
        ),
        Dimension(
            Quantity("tilt_deg", ("x", "y"), low=-45, high=45, default=0.0, wide=UNKNOWN_TILT),
            words="the cover's tilt",
            explanation=(
                "Degrees of tilt, first about x (right), then about y (down): 0,0 is straight."
            ),
            tolerance=COVER_TILT,
            effect="cover_tilt",
            option="tilt",
        ),
    ),
    surface="calib.optics.flat:Flat",
    origin=(None, None, "distance"),
    chart=(ChartAxis("y (mm)", 1e3), ChartAxis("x (mm)", 1e3)),
    example={"distance_mm": 25.0, "thickness_mm": 6.0, "refractive_index": 1.5},
    port="FLATPORT",
)
