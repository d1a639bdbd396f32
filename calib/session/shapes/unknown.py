"""The shape that nobody knows. A fit tries every other one."""

from calib.session.schema import UNKNOWN
from calib.session.shapes.shape import Shape

UNKNOWN_SHAPE = Shape(UNKNOWN, "a cover of unknown shape", is_known=False)
