"""The cover in front of the camera: its shapes, and the numbers that each of them has."""

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
"""Every shape a session may name, and the keys of each."""


@dataclass(frozen=True, slots=True)
class Cover:
    """A shape and its numbers: {"inner_radius": ..., "tilt.x": ...}, in SI units, by the names of
    `SHAPES`.
    """

    shape: str
    parameters: Mapping[str, Number]
    correlations: tuple[tuple[str, str, float], ...] = ()
    """Of pairs of numbers of which one at least is the cover's, called cover.thickness, camera.fx
    and so on; others are independent.
    """
    glass: Glass | None = None
    """What is known of its unevenness; None: what holds for any glass."""


def read_cover(section: Section) -> Cover:
    shapes = tuple(SHAPES)
    shape = section.choice("shape", shapes, f"one of {', '.join(shapes)}")
    section.only(
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
    """The mapping that `read_cover` reads as this cover."""
    written: dict[str, object] = {"shape": cover.shape}
    for quantity in SHAPES[cover.shape]:
        entries = [quantity.to_yaml(cover.parameters[name]) for name in quantity.names]
        written[quantity.key] = entries if quantity.components else entries[0]
    if cover.correlations:
        written[CORRELATIONS] = [list(pair) for pair in cover.correlations]
    if cover.glass:
        written[GLASS_KEY] = glass_to_yaml(cover.glass)
    return written


def _read_correlations(section: Section) -> tuple[tuple[str, str, float], ...]:
    """What they are of, and whether all can be true together, is checked where the camera is known
    too.
    """
    written = section.values.get(CORRELATIONS, [])
    if not isinstance(written, list):
        raise section.wrong(CORRELATIONS, written, PAIRS)
    found: list[tuple[str, str, float]] = []
    for index, entry in enumerate(written):
        match entry:
            case [str() as one, str() as other, value]:
                key = f"{CORRELATIONS}[{index}][2]"
                found.append((one, other, section.number(key, value, CORRELATION).value))
            case _:
                raise section.wrong(f"{CORRELATIONS}[{index}]", entry, PAIRS)
    return tuple(found)


def _refuse_camera_outside(section: Section, cover: Cover) -> None:
    n = {name: number.value for name, number in cover.parameters.items()}
    if cover.shape == "dome":
        away, radius, key, centre = (
            math.hypot(n["centre.x"], n["centre.y"], n["centre.z"]),
            n["inner_radius"],
            "centre_mm",
            "centre",
        )
    elif cover.shape in ("cone", "cylinder"):
        along = -_axis_dot_offset(n)  # m, of the pinhole, from the axis's point at y = 0
        away = math.sqrt(max(n["axis_offset.x"] ** 2 + n["axis_offset.z"] ** 2 - along**2, 0.0))
        radius, key, centre = (
            n["inner_radius"] + n.get("radius_slope", 0.0) * along,
            "axis_offset_mm",
            "axis",
        )
    else:
        return
    if away >= radius:
        raise InputError(
            f"{section.file}: {section.at(key)} puts the camera outside the {cover.shape},"
            f" {away * 1000:g} mm from its {centre} where the inner radius is {radius * 1000:g} mm:"
            f" write a smaller {key} or a larger inner_radius_mm."
        )


def _axis_dot_offset(n: Mapping[str, float]) -> float:
    """m. The axis is y, turned by the rotation vector (tilt.x, 0, tilt.z)."""
    angle = math.hypot(n["tilt.x"], n["tilt.z"])
    scale = math.sin(angle) / angle if angle else 1.0
    return scale * (n["tilt.x"] * n["axis_offset.z"] - n["tilt.z"] * n["axis_offset.x"])
