"""The names of the numbers of cameras and covers, as the ray path, files and messages have them.

This is the one place that builds them. A camera's numbers are camera.fx and so on. A cover's are
cover.thickness and so on, those of its second layer of glass cover.layer2.thickness, and those of a
second cover outside of it cover2.thickness.
"""

import re
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class CameraNames:
    """The names of one camera's numbers."""

    part: str = "camera"
    """The name of the camera, before the dot."""

    def of(self, key: str) -> str:
        """Return the name of the number with this key in session.yaml, such as k1."""
        return f"{self.part}.{key}"

    def has(self, name: str) -> bool:
        """True if this is the name of one of its numbers."""
        return name.startswith(f"{self.part}.")

    @property
    def fx(self) -> str:
        return self.of("fx")

    @property
    def fy(self) -> str:
        return self.of("fy")

    @property
    def cx(self) -> str:
        return self.of("cx")

    @property
    def cy(self) -> str:
        return self.of("cy")

    @property
    def focal(self) -> tuple[str, str]:
        """The names of the focal lengths."""
        return self.fx, self.fy

    @property
    def centre(self) -> tuple[str, str]:
        """The names of the principal point's coordinates."""
        return self.cx, self.cy

    @property
    def pinhole(self) -> tuple[str, str, str, str]:
        return *self.focal, *self.centre


@dataclass(frozen=True, slots=True)
class CoverNames:
    """The names of one cover's numbers."""

    part: str = "cover"
    """The name of the cover, before the dot."""

    def of(self, number: str) -> str:
        """Return the name of a number that the cover's shape calls so, such as inner_radius."""
        return f"{self.part}.{number}"

    def thickness(self, layer: int = 1) -> str:
        return self.of(layer_number(layer, THICKNESS))

    def refractive_index(self, layer: int = 1) -> str:
        return self.of(layer_number(layer, INDEX))

    @property
    def outside_index(self) -> str:
        return self.of("outside_index")


CAMERA = CameraNames()
COVER = CoverNames()
THICKNESS = "thickness"
INDEX = "refractive_index"
NUMBER = re.compile(r"cover[0-9]*\.(?:layer[0-9]+\.)?(.+)")


def cover_names(place: int) -> CoverNames:
    """Return the names of a cover's numbers. The innermost cover has place 1; the next one's are
    cover2.thickness and so on.
    """
    return COVER if place == 1 else CoverNames(f"{COVER.part}{place}")


def layer_number(layer: int, number: str) -> str:
    """Return what a cover calls a number of one of its layers of glass. The innermost layer is 1;
    the next one's are layer2.thickness and so on.
    """
    return number if layer == 1 else f"layer{layer}.{number}"


def number_of(name: str) -> str:
    """Return what a cover's shape or layer calls this number, such as inner_radius for
    cover.inner_radius and thickness for cover2.layer3.thickness; an empty text if it is no number
    of a cover.
    """
    match = NUMBER.fullmatch(name)
    return match[1] if match else ""
