"""A cylinder: a cone without a slope."""

from calib.session.shapes.cone import AXIS, CONE, INNER_RADIUS
from calib.session.shapes.shape import Shape

CYLINDER = Shape(
    "cylinder",
    "a cylinder",
    (INNER_RADIUS, *AXIS),
    surface=CONE.surface,
    origin=CONE.origin,
    constants={"radius_slope": 0.0},
    chart=CONE.chart,
    check_camera=CONE.check_camera,
    example={
        "inner_radius_mm": 42.0,
        "axis_offset_mm": [0.0, -30.0],
        "thickness_mm": 3.0,
        "refractive_index": 1.5,
    },
)
