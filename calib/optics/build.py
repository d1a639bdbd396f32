"""From the description in a session to a ray path and its numbers."""

from collections.abc import Mapping, Sequence

import torch
from torch import Tensor

from calib.camera import Intrinsics
from calib.cover import Cover
from calib.errors import InputError
from calib.optics.cone import Cone
from calib.optics.frame import Frame, Names
from calib.optics.interface import Interface
from calib.optics.lens import COEFFICIENTS, Lens
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.optics.surface import Surface

SHAPES = ("none", "cone", "cylinder")
"""The covers that can be traced."""

LATTICE = 41
"""Pixels along each side of the image that measure which part of the glass it sees."""


def pinhole_path(intrinsics: Intrinsics) -> tuple[Path, dict[str, Tensor]]:
    """The camera without its cover."""
    lens = intrinsics.distortion
    if all(number.value == 0 and number.sigma == 0 for number in lens):
        lens = ()
    names = ("fx", "fy", "cx", "cy", *COEFFICIENTS[: len(lens)])
    numbers = (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy, *lens)
    values = {f"camera.{name}": torch.tensor(number.value, dtype=torch.float64) for name, number in zip(names, numbers, strict=True)}
    return Path(Lens(len(lens))), values


def covered_path(intrinsics: Intrinsics, cover: Cover) -> tuple[Path, dict[str, Tensor]]:
    """The camera behind its perfect, smooth cover."""
    path, values = pinhole_path(intrinsics)
    if cover.shape == "none":
        return path, values
    if cover.shape not in SHAPES:
        raise InputError(f"cover.shape: {cover.shape!r} cannot be calibrated by this version, which knows {', '.join(SHAPES)}.")
    numbers = {f"cover.{name}": torch.tensor(number.value, dtype=torch.float64) for name, number in cover.numbers.items()}
    if cover.shape == "cylinder":
        numbers["cover.radius_slope"] = torch.zeros((), dtype=torch.float64)
    frame = Frame(origin=_present(numbers, "axis_offset"), tilt=_turned(cover, "tilt"))
    return Path(path.lens, _pair(Cone(), frame)), values | numbers


def with_relief(path: Path, relief: Relief, *, exact_hit: bool = True) -> Path:
    """The same path with an uneven outer surface. Its values need relief.amplitudes, of the shape relief.grid."""
    inner, outer = path.cover
    return Path(path.lens, (inner, Interface("outer", outer.surface, outer.frame, relief, exact_hit)), path.target)


def footprint(path: Path, values: Values, width: int, height: int) -> tuple[tuple[float, float], tuple[float, float]]:
    """The patch of the outer surface that an image of width x height px sees: low and high chart coordinates."""
    columns = torch.linspace(-0.5, width - 0.5, LATTICE, dtype=torch.float64)
    rows = torch.linspace(-0.5, height - 0.5, LATTICE, dtype=torch.float64)
    pixels = torch.cartesian_prod(columns, rows)
    rays = path.trace(pixels, values)
    outer = path.cover[-1]
    first, second = outer.surface.chart(outer.frame.enter(rays.origin, values))
    seen = rays.failure == 0
    if not bool(seen.any()):
        raise InputError("cover: no ray of the camera leaves this cover; check its radius, offset and thickness in session.yaml.")
    first, second = first[seen], second[seen]
    return (float(first.min()), float(second.min())), (float(first.max()), float(second.max()))


def _pair(surface: Surface, frame: Frame) -> tuple[Interface, Interface]:
    return Interface("inner", surface, frame), Interface("outer", surface, frame)


def _present(numbers: Mapping[str, Tensor], key: str) -> Names:
    return _names([f"cover.{key}.{axis}" if f"cover.{key}.{axis}" in numbers else None for axis in "xyz"])


def _turned(cover: Cover, key: str) -> Names:
    """The tilt's names; none for a tilt that is zero and stays zero, which saves the rotations."""
    numbers = cover.numbers
    names = [f"{key}.{axis}" if f"{key}.{axis}" in numbers else None for axis in "xyz"]
    still = all(numbers[name].value == 0 and numbers[name].sigma == 0 for name in names if name)
    return (None, None, None) if still else _names([f"cover.{name}" if name else None for name in names])


def _names(names: Sequence[str | None]) -> Names:
    x, y, z = names
    return x, y, z
