"""The description of a cover's shape: its numbers, their checks, and the words for it.

A shape is one object in one file. `calib.session.shapes.registry` lists them all.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from calib.session.shapes.dimension import Dimension
from calib.session.shapes.layer import LAYER, OUTSIDE

Numbers = Mapping[str, float]
"""A cover's numbers in SI units, by their names: inner_radius, tilt.x."""
Origin = tuple[str | None, str | None, str | None]
"""The names of the numbers that are x, y and z of a point; None for a coordinate that is zero."""


@dataclass(frozen=True, slots=True)
class ChartAxis:
    """One coordinate of a shape's chart, on which its relief and the figures of reports lie."""

    label: str
    """The label of an axis, with its unit."""
    per_si: float
    """The number of the label's units in one SI unit."""


@dataclass(frozen=True, slots=True)
class CameraOutside:
    """The error that the pinhole lies outside of a cover's inner surface."""

    key: str
    """The key that places the cover."""
    detail: str
    """The end of "KEY puts the camera outside the SHAPE": by how much, and what to write."""


def check_round(distance: float, radius: float, key: str, centre: str) -> CameraOutside | None:
    """Return the error if the pinhole's distance from a round cover's `centre`, m, is not smaller
    than the inner radius there, m; else None. `key` places that centre.
    """
    if distance < radius:
        return None
    return CameraOutside(
        key,
        f", {distance * 1000:g} mm from its {centre} where the inner radius is {radius * 1000:g}"
        f" mm: write a smaller {key} or a larger inner_radius_mm.",
    )


@dataclass(frozen=True, slots=True)
class Shape:
    """A shape that a cover may have."""

    name: str
    """The name in session.yaml."""
    words: str
    """The words for a cover of this shape, such as "a dome"."""
    dimensions: tuple[Dimension, ...] = ()
    """The numbers that give its size and its place, the size first, without those of the glass."""
    surface: str = ""
    """The module and the class of its surface (`calib.optics.surface`), such as
    calib.optics.dome:Dome. It is a name, because a session is read without torch. Empty: there is
    no glass.
    """
    origin: Origin = (None, None, None)
    """The names of the coordinates of the cover's origin in the camera frame."""
    constants: Numbers = field(default_factory=dict)
    """Numbers of its surface that no session states."""
    chart: tuple[ChartAxis, ChartAxis] | None = None
    """The first coordinate, which figures draw downwards, and the second one."""
    check_camera: Callable[[Numbers], CameraOutside | None] | None = None
    """The check that the pinhole is inside a cover with these numbers. None: the limits of the
    numbers keep it there.
    """
    example: Mapping[str, object] = field(default_factory=dict)
    """An example of its keys in session.yaml, without the shape's name."""
    is_known: bool = True
    """False for the shape that nobody knows: only its glass has numbers."""
    port: str = ""
    """The port of Calibmar and COLMAP's underwater fork that is exactly this shape, if any."""

    @property
    def has_glass(self) -> bool:
        return bool(self.surface) or not self.is_known

    @property
    def keys(self) -> tuple[Dimension, ...]:
        """The dimensions in the order of session.yaml, those of the glass included."""
        return (*self.dimensions, *LAYER, OUTSIDE) if self.has_glass else ()

    @property
    def tilt_axes(self) -> str:
        """The axes about which a session may turn it, such as "xz"."""
        return "".join(
            axis
            for dimension in self.dimensions
            if dimension.quantity.key == "tilt_deg"
            for axis in dimension.quantity.components
        )
