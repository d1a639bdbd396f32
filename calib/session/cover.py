"""The cover in front of the camera: a shape and its numbers."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from calib.errors import InputError
from calib.session.glass import Glass, glass_to_yaml, read_glass
from calib.session.parameter_names import COVER
from calib.session.schema import Number, Quantity, Section
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.registry import find_shape, shape_names
from calib.session.shapes.shape import Shape

CORRELATIONS = "correlations"
GLASS_KEY = "glass"
CORRELATION = Quantity(CORRELATIONS, low=-1, high=1)
PAIRS = (
    "two names and a number from -1 to 1 for each pair of numbers, such as [[cover.thickness,"
    " camera.fx, 0.5]]"
)


@dataclass(frozen=True, slots=True)
class Cover:
    """A shape and its numbers: {"inner_radius": ..., "tilt.x": ...}, in SI units, with the names of
    the shape's dimensions.
    """

    shape: str
    parameters: Mapping[str, Number]
    correlations: tuple[tuple[str, str, float], ...] = ()
    """Correlations of pairs of numbers, called cover.thickness, camera.fx and so on. At least one
    number of a pair is the cover's. Other pairs are independent.
    """
    glass: Glass | None = None
    """The prior of the cover's unevenness; None: the prior for any glass."""

    @property
    def numbers(self) -> dict[str, Number]:
        """Its numbers by the names that the ray path gives them: cover.thickness."""
        return {COVER.of(name): number for name, number in self.parameters.items()}

    @property
    def dimensions(self) -> dict[str, Dimension]:
        """The dimension of each of these numbers, in the order of session.yaml."""
        return {
            COVER.of(name): dimension
            for dimension in find_shape(self.shape).keys
            for name in dimension.quantity.names
        }

    def replace_numbers(self, numbers: Mapping[str, Number]) -> "Cover":
        """Return the cover with those of these numbers that it has. Everything else stays."""
        parameters = {
            name: numbers.get(COVER.of(name), number) for name, number in self.parameters.items()
        }
        return replace(self, parameters=parameters)


def read_cover(section: Section) -> Cover:
    """Read the section `cover` of session.yaml; raise InputError if it is not valid."""
    names = shape_names()
    shape = find_shape(section.choice("shape", names, f"one of {', '.join(names)}"))
    quantities = [dimension.quantity for dimension in shape.keys]
    section.allow_only(
        ("shape", *(quantity.key for quantity in quantities), CORRELATIONS, GLASS_KEY),
        f"key of the shape {shape.name}",
    )
    parameters = {
        name: number for quantity in quantities for name, number in section.read(quantity).items()
    }
    glass = (
        read_glass(section.section(GLASS_KEY, "what calib fleet-prior wrote"))
        if GLASS_KEY in section.values
        else None
    )
    cover = Cover(shape.name, parameters, _read_correlations(section), glass)
    _refuse_camera_outside(section, shape, parameters)
    return cover


def cover_to_yaml(cover: Cover) -> dict[str, object]:
    """Return the mapping that `read_cover` reads as this cover."""
    document: dict[str, object] = {"shape": cover.shape}
    for dimension in find_shape(cover.shape).keys:
        quantity = dimension.quantity
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


def _refuse_camera_outside(
    section: Section, shape: Shape, parameters: Mapping[str, Number]
) -> None:
    """Raise InputError if the camera lies outside the cover's inner surface."""
    if not shape.camera_place:
        return
    place = shape.camera_place({name: number.value for name, number in parameters.items()})
    if place.distance >= place.radius:
        raise InputError(
            f"{section.file}: {section.key_path(place.key)} puts the camera outside the"
            f" {shape.name}, {place.distance * 1000:g} mm from its {place.centre} where the inner"
            f" radius is {place.radius * 1000:g} mm: write a smaller {place.key} or a larger"
            " inner_radius_mm."
        )
