"""A cone around an axis that is about upright in the camera frame."""

import math

from calib.session.schema import Quantity
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.shape import CameraOutside, ChartAxis, Numbers, Shape, check_round
from calib.session.tolerances import (
    COVER_TILT,
    OFFSET,
    RADIUS,
    RADIUS_SLOPE,
    UNKNOWN_OFFSET,
    UNKNOWN_RADIUS,
    UNKNOWN_SLOPE,
    UNKNOWN_TILT,
)

INNER_RADIUS = Dimension(
    Quantity("inner_radius_mm", low=0.05, high=1e5, wide=UNKNOWN_RADIUS),
    words="the cover's inner radius",
    explanation="Inner radius in millimetres, at the height of the lens.",
    tolerance=RADIUS,
    option="radius",
    effect="cover_radius",
)
SLOPE = Dimension(
    Quantity("radius_slope", low=-2, high=2, wide=UNKNOWN_SLOPE),
    words="the cover's slope",
    explanation="By how much the radius grows downwards: -0.1 is 1 mm narrower every 10 mm.",
    tolerance=RADIUS_SLOPE,
    option="slope",
    effect="cover_radius",
)
AXIS = (
    Dimension(
        Quantity("axis_offset_mm", ("x", "z"), low=-1e5, high=1e5, wide=UNKNOWN_OFFSET),
        words="the place of the cover's axis (axis_offset_mm)",
        explanation=(
            "From the lens to the cover's axis in mm, x right, z ahead: 0,-30 is 30 mm behind."
        ),
        tolerance=OFFSET,
        option="offset",
        effect="cover_offset",
    ),
    Dimension(
        Quantity("tilt_deg", ("x", "z"), low=-45, high=45, default=0.0, wide=UNKNOWN_TILT),
        words="the cover's tilt",
        explanation=(
            "Degrees of tilt, first about x (right), then about z (ahead): 0,0 is straight."
        ),
        tolerance=COVER_TILT,
        effect="cover_tilt",
        option="tilt",
    ),
)
CHART = (
    ChartAxis("along the axis (mm)", 1e3),
    ChartAxis("around the axis (°)", math.degrees(1)),
)


def check_in_cone(numbers: Numbers) -> CameraOutside | None:
    """Check that the pinhole is inside a cone or, without a slope, a cylinder."""
    x, z = numbers["axis_offset.x"], numbers["axis_offset.z"]
    angle = math.hypot(numbers["tilt.x"], numbers["tilt.z"])
    scale = math.sin(angle) / angle if angle else 1.0
    # The axis is y, turned by the rotation vector (tilt.x, 0, tilt.z). `axial` is the pinhole's
    # coordinate along it, m, from the axis's point at y = 0.
    axial = -scale * (numbers["tilt.x"] * z - numbers["tilt.z"] * x)
    distance = math.sqrt(max(x**2 + z**2 - axial**2, 0.0))
    radius = numbers["inner_radius"] + numbers.get("radius_slope", 0.0) * axial
    return check_round(distance, radius, key="axis_offset_mm", centre="axis")


CONE = Shape(
    "cone",
    "a cone",
    (INNER_RADIUS, SLOPE, *AXIS),
    surface="calib.optics.cone:Cone",
    origin=("axis_offset.x", None, "axis_offset.z"),
    chart=CHART,
    check_camera=check_in_cone,
    example={
        "inner_radius_mm": 42.0,
        "radius_slope": -0.1,
        "axis_offset_mm": [0.0, -30.0],
        "thickness_mm": 3.0,
        "refractive_index": 1.5,
    },
)
