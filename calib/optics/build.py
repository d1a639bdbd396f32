"""From the description in a session to a ray path and its parameters."""

import torch
from torch import Tensor

from calib.errors import InputError
from calib.optics.cone import Cone
from calib.optics.cover_frame import CoverFrame, Names
from calib.optics.dome import Dome
from calib.optics.fisheye import Fisheye
from calib.optics.flat import Flat
from calib.optics.interface import Interface
from calib.optics.lens import Lens
from calib.optics.lens_model import LensModel
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.optics.splined import GRID, SHIFTS, Grid, Splined
from calib.optics.surface import Surface
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.lens import FISHEYE, NAMES, OPENCV

BEYOND = 0.2
"""How far the relief's centres reach beyond what the image sees, as a fraction of it, on each side.
Without centres beyond the edge a sum of Gaussians falls off there, and an even thickness, say,
could not be held (the bumps fixture keeps 0.060 px, not 0.030).
"""

LATTICE = 41
"""Pixels along each side of the image that measure which part of the glass it sees."""


def pinhole_path(intrinsics: Intrinsics) -> tuple[Path, dict[str, Tensor]]:
    """The camera without its cover."""
    coefficients = (
        dict(zip(intrinsics.names, intrinsics.distortion, strict=True))
        if intrinsics.distorts
        else {}
    )
    pinhole = {name: getattr(intrinsics, name) for name in ("fx", "fy", "cx", "cy")}
    values = {
        f"camera.{name}": torch.tensor(number.value, dtype=torch.float64)
        for name, number in (pinhole | coefficients).items()
    }
    if spline := intrinsics.spline:
        values |= {
            name: torch.tensor(shifts, dtype=torch.float64)
            for name, shifts in zip(SHIFTS, (spline.x, spline.y), strict=True)
        }
        values[GRID] = Grid(spline.size, (spline.columns, spline.rows)).described
    return Path(lens_of(values)), values


def lens_of(values: Values) -> Lens:
    """The lens whose numbers are among the values of a path."""
    if GRID in values:
        return Splined(Grid.of(values))
    if f"camera.{NAMES[FISHEYE][0]}" in values:
        return Fisheye()
    return LensModel(sum(f"camera.{name}" in values for name in NAMES[OPENCV]))


def covered_path(intrinsics: Intrinsics, cover: Cover) -> tuple[Path, dict[str, Tensor]]:
    """The camera behind its perfect, smooth cover."""
    path, values = pinhole_path(intrinsics)
    if cover.shape == "none":
        return path, values
    parameters = {
        f"cover.{name}": torch.tensor(number.value, dtype=torch.float64)
        for name, number in cover.parameters.items()
    }
    if cover.shape == "cylinder":
        parameters["cover.radius_slope"] = torch.zeros((), dtype=torch.float64)
    surface, frame = _placed(cover)
    return (
        Path(path.lens, (Interface("inner", surface, frame), Interface("outer", surface, frame))),
        values | parameters,
    )


def with_relief(path: Path, relief: Relief, *, exact_hit: bool = True) -> Path:
    """The same path with an uneven outer surface.

    Its values need relief.amplitudes, of the shape relief.grid.
    """
    inner, outer = path.cover
    return Path(
        path.lens,
        (inner, Interface("outer", outer.surface, outer.frame, relief, exact_hit)),
        path.target,
    )


def footprint(
    path: Path, values: Values, width: int, height: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """The patch for the relief, low and high chart coordinates: what an image of width x height px
    sees of the glass, and some more.
    """
    columns = torch.linspace(-0.5, width - 0.5, LATTICE, dtype=torch.float64)
    rows = torch.linspace(-0.5, height - 0.5, LATTICE, dtype=torch.float64)
    pixels = torch.cartesian_prod(columns, rows)
    rays = path.trace(pixels, values)
    outer = path.cover[-1]
    first, second = outer.surface.chart(outer.frame.at(values).enter(rays.origin))
    seen = rays.failure == 0
    if not bool(seen.any()):
        raise InputError(
            "cover: no ray of the camera leaves this cover; check its radius, offset and thickness"
            " in session.yaml."
        )
    first, second = first[seen], second[seen]
    lows, highs = [c.min() for c in (first, second)], [c.max() for c in (first, second)]
    beyond = [BEYOND * (high - low) for low, high in zip(lows, highs, strict=True)]
    (a, b), (c, d) = (
        [float(edge + sign * more) for edge, more in zip(edges, beyond, strict=True)]
        for edges, sign in ((lows, -1), (highs, 1))
    )
    return (a, b), (c, d)


def _placed(cover: Cover) -> tuple[Surface, CoverFrame]:
    """The cover's surface, and where it stands.

    Every shape of calib.session.cover.SHAPES that has glass is here.
    """
    match cover.shape:
        case "cone" | "cylinder":
            return Cone(), CoverFrame(origin=_names(cover, "axis_offset"), tilt=_turned(cover))
        case (
            "flat"
            # turned about the point of its inner face on the optical axis, so the distance along
            # that axis stays
        ):
            return Flat(), CoverFrame(origin=(None, None, "cover.distance"), tilt=_turned(cover))
        case "dome":
            return Dome(), CoverFrame(origin=_names(cover, "centre"))
        case other:
            raise ValueError(f"{other!r} is not a shape of calib.session.cover.SHAPES")


def _names(cover: Cover, key: str) -> Names:
    """What the values call a number's x, y and z; None for those that the shape does not have."""
    x, y, z = (
        f"cover.{key}.{axis}" if f"{key}.{axis}" in cover.parameters else None for axis in "xyz"
    )
    return x, y, z


def _turned(cover: Cover) -> Names:
    """The tilt's names; none for a tilt that is zero and stays zero, which saves the rotations."""
    tilt = [number for name, number in cover.parameters.items() if name.startswith("tilt.")]
    return (
        (None, None, None)
        if all(number.value == 0 and number.sigma == 0 for number in tilt)
        else _names(cover, "tilt")
    )
