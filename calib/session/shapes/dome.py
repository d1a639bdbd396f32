"""A dome: concentric spheres."""

import math
from dataclasses import replace

from calib.session.schema import Quantity
from calib.session.shapes.cone import INNER_RADIUS
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.shape import CameraOutside, ChartAxis, Numbers, Shape, check_round
from calib.session.tolerances import OFFSET, UNKNOWN_OFFSET


def check_in_dome(numbers: Numbers) -> CameraOutside | None:
    """Check that the pinhole is inside a dome."""
    distance = math.hypot(numbers["centre.x"], numbers["centre.y"], numbers["centre.z"])
    return check_round(distance, numbers["inner_radius"], key="centre_mm", centre="centre")


DOME = Shape(
    "dome",
    "a dome",
    (
        replace(
            INNER_RADIUS,
            explanation="Inner radius in millimetres.",
        ),
        Dimension(
            Quantity("centre_mm", ("x", "y", "z"), low=-1e5, high=1e5, wide=UNKNOWN_OFFSET),
            words="the dome's centre (centre_mm)",
            explanation=(
                "From the lens to the dome's centre in mm, x right, y down, z ahead: 0,0,-8 is"
                " 8 mm behind."
            ),
            tolerance=OFFSET,
            option="centre",
            effect="cover_offset",
        ),
    ),
    surface="calib.optics.dome:Dome",
    origin=("centre.x", "centre.y", "centre.z"),
    chart=(
        ChartAxis("elevation (°)", math.degrees(1)),
        ChartAxis("azimuth (°)", math.degrees(1)),
    ),
    check_camera=check_in_dome,
    example={
        "inner_radius_mm": 50.0,
        "centre_mm": [0.0, 0.0, 0.0],
        "thickness_mm": 3.0,
        "refractive_index": 1.5,
    },
    port="DOMEPORT",
)
