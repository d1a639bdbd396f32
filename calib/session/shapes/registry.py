"""The registry of all shapes: a new shape is a file of its own and a line here."""

from collections.abc import Iterator

from calib.session.shapes.cone import CONE
from calib.session.shapes.cylinder import CYLINDER
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.dome import DOME
from calib.session.shapes.flat import FLAT
from calib.session.shapes.layer import LAYER, OUTSIDE
from calib.session.shapes.none import NONE
from calib.session.shapes.shape import Shape
from calib.session.shapes.unknown import UNKNOWN_SHAPE

SHAPES: tuple[Shape, ...] = (NONE, CONE, CYLINDER, FLAT, DOME)
"""Every shape that a session may name, in the order in which a form offers them.

Other modules read it by the functions below, so that a shape that is added to it is known
everywhere.
"""


def shape_names() -> tuple[str, ...]:
    """Return the names of the shapes that a cover may have."""
    return tuple(shape.name for shape in SHAPES)


def stated_shape_names() -> tuple[str, ...]:
    """Return the names that a session may state: those of all shapes, and unknown."""
    return (*shape_names(), UNKNOWN_SHAPE.name)


def find_shape(name: str) -> Shape:
    """Return the shape of this name; raise LookupError if there is none."""
    for shape in (*SHAPES, UNKNOWN_SHAPE):
        if shape.name == name:
            return shape
    raise LookupError(f"{name!r} is not a shape of calib.session.shapes.registry.SHAPES")


def dimensions() -> Iterator[Dimension]:
    """Yield the dimensions of all shapes, those of their glass last. Several shapes may have the
    same ones.
    """
    for shape in SHAPES:
        yield from shape.dimensions
    yield from (*LAYER, OUTSIDE)


def find_dimension(number: str) -> Dimension | None:
    """Return the dimension of a number such as tilt.x. It is the same for all shapes, but for its
    words.
    """
    return next((entry for entry in dimensions() if number in entry.quantity.names), None)
