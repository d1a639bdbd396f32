"""The cover in front of the camera: a shape with layers of glass, and its numbers; or several
such covers, one in front of the other.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from itertools import count

from calib.session.dispersion import Dispersion
from calib.session.glass import Glass
from calib.session.parameter_names import THICKNESS, cover_names, layer_number
from calib.session.schema import Number
from calib.session.shapes.dimension import Dimension
from calib.session.shapes.layer import LAYER, OUTSIDE
from calib.session.shapes.registry import find_shape

MEDIUM = OUTSIDE.quantity.stem
"""The name of the index of what is outside of a cover."""
AUTO, EVEN, UNEVEN = SURFACES = ("auto", "even", "uneven")
"""The outer surface: as the views have it, without a relief, or with one."""


@dataclass(frozen=True, slots=True)
class Cover:
    """A shape and its numbers: {"inner_radius": ..., "tilt.x": ...}, in SI units, with the names of
    the shape's dimensions. The glass of the first layer, the innermost, has "thickness" and
    "refractive_index", that of the second has "layer2.thickness", and so on.
    """

    shape: str
    parameters: Mapping[str, Number]
    correlations: tuple[tuple[str, str, float], ...] = ()
    """Correlations of pairs of numbers, called cover.thickness, camera.fx and so on. At least one
    number of a pair is a cover's. Other pairs are independent. Those of all covers are here, in the
    innermost one.
    """
    glass: Glass | None = None
    """The prior of the unevenness of the outermost surface; None: the prior for any glass. It is
    here, in the innermost cover.
    """
    surface: str = AUTO
    """Whether its outer surface is even: one of SURFACES. Only that of the outermost cover is used.
    """
    dispersion: Mapping[str, Dispersion] = field(default_factory=dict)
    """The dispersion of its media by the name of their index, such as "refractive_index". A medium
    that is not here has one index for all colours.
    """
    outer: "Cover | None" = None
    """The next cover outwards; None: this one is the outermost."""

    @property
    def has_unknown_shape(self) -> bool:
        """True if nobody knows the shape."""
        return not find_shape(self.shape).is_known

    def as_shape(self, name: str) -> "Cover":
        """Return a cover of unknown shape as one of this shape, whose size and place are
        unknown.
        """
        shape = find_shape(name)
        if not shape.has_glass:
            return Cover(name, {})
        placement: dict[str, Number] = {}
        for dimension in shape.dimensions:
            placement |= dimension.quantity.unknown_numbers
        return replace(self, shape=name, parameters={**placement, **self.parameters})

    @property
    def covers(self) -> tuple["Cover", ...]:
        """All covers, from the camera outwards, with this one as the first."""
        return (self, *(self.outer.covers if self.outer else ()))

    @property
    def layers(self) -> int:
        """The number of its layers of glass."""
        return next(
            layer for layer in count() if layer_number(layer + 1, THICKNESS) not in self.parameters
        )

    @property
    def kinds(self) -> dict[str, Dimension]:
        """The dimension of each of its parameters, in the order of session.yaml, without the other
        covers.
        """
        shape = find_shape(self.shape)
        if not shape.has_glass:
            return {}
        layers = {
            layer_number(layer, kind.quantity.stem): kind
            for layer in range(1, self.layers + 1)
            for kind in LAYER
        }
        placement = {name: kind for kind in shape.dimensions for name in kind.quantity.names}
        return placement | layers | {MEDIUM: OUTSIDE}

    @property
    def dimensions(self) -> dict[str, Dimension]:
        """The dimension of each number of all covers, in the order of session.yaml, by the names
        that the ray path gives them: cover.thickness.
        """
        return {
            cover_names(place).of(name): kind
            for place, cover in enumerate(self.covers, 1)
            for name, kind in cover.kinds.items()
        }

    @property
    def numbers(self) -> dict[str, Number]:
        """The numbers of all covers, by the same names."""
        return {
            cover_names(place).of(name): number
            for place, cover in enumerate(self.covers, 1)
            for name, number in cover.parameters.items()
        }

    @property
    def medium_name(self) -> str:
        """The name of the index of the medium outside of all covers."""
        return cover_names(len(self.covers)).of(MEDIUM)

    @property
    def medium(self) -> Number | None:
        """The index of the medium outside of all covers; None without a cover."""
        return self.numbers.get(self.medium_name)

    @property
    def words(self) -> str:
        """The words for all covers in a sentence: "a dome and a flat window of 3 layers"."""
        return " and ".join(cover.single_words for cover in self.covers)

    @property
    def single_words(self) -> str:
        """The words for this cover without the other ones."""
        words = find_shape(self.shape).words
        return f"{words} of {self.layers} layers" if self.layers > 1 else words

    @property
    def has_dispersion(self) -> bool:
        """True if the index of any medium depends on the colour."""
        return any(cover.dispersion for cover in self.covers)

    def in_channel(self, channel: str) -> "Cover":
        """Return the cover as the light of a colour meets it, one of dispersion.CHANNELS."""
        numbers = dict(self.parameters)
        for name, dispersion in self.dispersion.items():
            index = dispersion.index(numbers[name].value, channel)
            numbers[name] = replace(numbers[name], value=index)
        outer = self.outer and self.outer.in_channel(channel)
        return replace(self, parameters=numbers, dispersion={}, outer=outer)

    def replace_medium(self, medium: Number, dispersion: Dispersion | None) -> "Cover":
        """Return the cover with another medium outside of all covers."""
        if self.outer:
            return replace(self, outer=self.outer.replace_medium(medium, dispersion))
        dispersions = {name: colours for name, colours in self.dispersion.items() if name != MEDIUM}
        if dispersion:
            dispersions[MEDIUM] = dispersion
        return replace(self, parameters={**self.parameters, MEDIUM: medium}, dispersion=dispersions)

    def with_surface(self, surface: str) -> "Cover":
        """Return the same cover whose outermost surface is one of SURFACES."""
        if self.outer:
            return replace(self, outer=self.outer.with_surface(surface))
        return replace(self, surface=surface)

    def replace_numbers(self, numbers: Mapping[str, Number]) -> "Cover":
        """Return the cover with those of these numbers that it has. Everything else stays."""
        outer: Cover | None = None
        for place, cover in reversed([*enumerate(self.covers, 1)]):
            parameters = {
                name: numbers.get(cover_names(place).of(name), number)
                for name, number in cover.parameters.items()
            }
            outer = replace(cover, parameters=parameters, outer=outer)
        assert outer
        return outer
