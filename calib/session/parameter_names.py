"""The names of the numbers of cameras and covers, as the ray path, files and messages have them.

This is the one place that builds them. A camera's numbers are camera.fx and so on. A cover's are
cover.thickness and so on.
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

    @property
    def thickness(self) -> str:
        return self.of("thickness")

    @property
    def refractive_index(self) -> str:
        return self.of("refractive_index")

    @property
    def outside_index(self) -> str:
        return self.of("outside_index")


CAMERA = CameraNames()
COVER = CoverNames()
NUMBER = re.compile(r"cover\.(.+)")


def number_of(name: str) -> str:
    """Return the name that the cover's shape gives this number, such as inner_radius for
    cover.inner_radius; an empty text if it is no number of a cover.
    """
    match = NUMBER.fullmatch(name)
    return match[1] if match else ""
