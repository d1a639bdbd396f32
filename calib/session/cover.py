"""The cover in front of the camera: its shapes, and the numbers of each shape."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from calib.errors import InputError
from calib.session.glass import Glass, glass_to_yaml, read_glass
from calib.session.schema import Number, Quantity, Section

RADIUS = Quantity("inner_radius_mm", low=0.05, high=1e5)
GLASS = (
    Quantity("thickness_mm", low=0.05, high=1e4),
    Quantity("refractive_index", low=1, high=3),
    Quantity("outside_index", low=1, high=3, default=1.0),
)
CORRELATIONS = "correlations"
GLASS_KEY = "glass"
CORRELATION = Quantity(CORRELATIONS, low=-1, high=1)
PAIRS = (
    "two names and a number from -1 to 1 for each pair of numbers, such as [[cover.thickness,"
    " camera.fx, 0.5]]"
)
AXIS = (
    Quantity("axis_offset_mm", ("x", "z"), low=-1e5, high=1e5),
    Quantity("tilt_deg", ("x", "z"), low=-45, high=45, default=0.0),
)
SHAPES: Mapping[str, tuple[Quantity, ...]] = {
    "none": (),
    "cone": (RADIUS, Quantity("radius_slope", low=-2, high=2), *AXIS, *GLASS),
    "cylinder": (RADIUS, *AXIS, *GLASS),
    "flat": (
        Quantity("distance_mm", low=0.05, high=1e5),
        Quantity("tilt_deg", ("x", "y"), low=-45, high=45, default=0.0),
        *GLASS,
    ),
    "dome": (RADIUS, Quantity("centre_mm", ("x", "y", "z"), low=-1e5, high=1e5), *GLASS),
}
"""Every shape that a session may name, and its keys."""


@dataclass(frozen=True, slots=True)
class Cover:
    """A shape and its numbers: {"inner_radius": ..., "tilt.x": ...}, in SI units, with the names of
    `SHAPES`.
    """

    shape: str
    parameters: Mapping[str, Number]
    correlations: tuple[tuple[str, str, float], ...] = ()
    """Correlations of pairs of numbers, called cover.thickness, camera.fx and so on. At least one
    number of a pair is the cover's. Other pairs are independent.
    """
    glass: Glass | None = None
    """The prior of the cover's unevenness; None: the prior for any glass."""


def read_cover(section: Section) -> Cover:
    """Read the section `cover` of session.yaml; raise InputError if it is not valid."""
    shapes = tuple(SHAPES)
    shape = section.choice("shape", shapes, f"one of {', '.join(shapes)}")
    section.allow_only(
        ("shape", *(quantity.key for quantity in SHAPES[shape]), CORRELATIONS, GLASS_KEY),
        f"key of the shape {shape}",
    )
    parameters = {
        name: number
        for quantity in SHAPES[shape]
        for name, number in section.read(quantity).items()
    }
    glass = (
        read_glass(section.section(GLASS_KEY, "what calib fleet-prior wrote"))
        if GLASS_KEY in section.values
        else None
    )
    cover = Cover(shape, parameters, _read_correlations(section), glass)
    _refuse_camera_outside(section, cover)
    return cover


def cover_to_yaml(cover: Cover) -> dict[str, object]:
    """Return the mapping that `read_cover` reads as this cover."""
    document: dict[str, object] = {"shape": cover.shape}
    for quantity in SHAPES[cover.shape]:
        entries = [quantity.to_yaml(cover.parameters[name]) for name in quantity.names]
        document[quantity.key] = entries if quantity.components else entries[0]
    if cover.correlations:
        document[CORRELATIONS] = [list(pair) for pair in cover.correlations]
    if cover.glass:
        document[GLASS_KEY] = glass_to_yaml(cover.glass)
    return document


def _read_correlations(section: Section) -> tuple[tuple[str, str, float], ...]:
    """Read the pairs. Their names, and whether all correlations are possible together, are checked
    once the camera is known (`check_correlations`).
    """
    pairs = section.values.get(CORRELATIONS, [])
    if not isinstance(pairs, list):
        raise section.error(CORRELATIONS, pairs, PAIRS)
    correlations: list[tuple[str, str, float]] = []
    for index, entry in enumerate(pairs):
        match entry:
            case [str() as first, str() as second, value]:
                key = f"{CORRELATIONS}[{index}][2]"
                correlations.append((first, second, section.number(key, value, CORRELATION).value))
            case _:
                raise section.error(f"{CORRELATIONS}[{index}]", entry, PAIRS)
    return tuple(correlations)


def _refuse_camera_outside(section: Section, cover: Cover) -> None:
    """Raise InputError if the camera lies outside the cover's inner surface."""
    n = {name: number.value for name, number in cover.parameters.items()}
    if cover.shape == "dome":
        distance = math.hypot(n["centre.x"], n["centre.y"], n["centre.z"])
        radius = n["inner_radius"]
        key = "centre_mm"
        centre = "centre"
    elif cover.shape in ("cone", "cylinder"):
        axial = -_axis_dot_offset(n)  # m, of the pinhole, from the axis's point at y = 0
        radial_squared = n["axis_offset.x"] ** 2 + n["axis_offset.z"] ** 2 - axial**2
        distance = math.sqrt(max(radial_squared, 0.0))
        radius = n["inner_radius"] + n.get("radius_slope", 0.0) * axial
        key = "axis_offset_mm"
        centre = "axis"
    else:
        return
    if distance >= radius:
        raise InputError(
            f"{section.file}: {section.key_path(key)} puts the camera outside the {cover.shape},"
            f" {distance * 1000:g} mm from its {centre} where the inner radius is"
            f" {radius * 1000:g} mm: write a smaller {key} or a larger inner_radius_mm."
        )


def _axis_dot_offset(n: Mapping[str, float]) -> float:
    """Return the component of the axis's offset along the axis, m. The axis is y, turned by the
    rotation vector (tilt.x, 0, tilt.z).
    """
    angle = math.hypot(n["tilt.x"], n["tilt.z"])
    scale = math.sin(angle) / angle if angle else 1.0
    return scale * (n["tilt.x"] * n["axis_offset.z"] - n["tilt.z"] * n["axis_offset.x"])
