"""No cover: a camera by itself."""

from calib.session.shapes.shape import Shape

NONE = Shape("none", "no cover")
