"""Functions that build a ray path and its parameters from the description in a session."""

from dataclasses import replace
from pkgutil import resolve_name

import torch
from torch import Tensor

from calib.errors import InputError
from calib.optics.cover_frame import CoverFrame, Names
from calib.optics.exposure import MIDDLE
from calib.optics.fisheye import Fisheye
from calib.optics.interface import SmoothCover, interfaces_of
from calib.optics.lens import Lens
from calib.optics.lens_model import LensModel
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.optics.splined_fisheye import SHIFTS, Grid, SplinedFisheye
from calib.optics.surface import Surface
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.lens import FISHEYE
from calib.session.parameter_names import CAMERA, CoverNames, cover_names
from calib.session.shapes.registry import find_shape
from calib.session.shapes.shape import Shape

FOOTPRINT_MARGIN = 0.2
"""The margin of the relief's region on each side, as a fraction of the glass that the image sees:
as the cover's numbers change, the image sees more of it.
"""

LATTICE = 41
"""The number of pixels along each side of the image that sample the patch of glass it sees."""


def pinhole_path(intrinsics: Intrinsics) -> tuple[Path, dict[str, Tensor]]:
    """Return the path of the camera without its cover, and its values."""
    coefficients = (
        dict(zip(intrinsics.names, intrinsics.distortion, strict=True))
        if intrinsics.distorts
        else {}
    )
    pinhole = {name: getattr(intrinsics, name) for name in ("fx", "fy", "cx", "cy")}
    values = {
        CAMERA.of(name): torch.tensor(number.value, dtype=torch.float64)
        for name, number in (pinhole | coefficients).items()
    }
    if spline := intrinsics.spline:
        values |= {
            name: torch.tensor(shifts, dtype=torch.float64)
            for name, shifts in zip(SHIFTS, (spline.x, spline.y), strict=True)
        }
    return Path(_lens(intrinsics)), values


def _lens(intrinsics: Intrinsics) -> Lens:
    if spline := intrinsics.spline:
        return SplinedFisheye(Grid(spline.size, (spline.columns, spline.rows)))
    if intrinsics.model == FISHEYE:
        return Fisheye()
    return LensModel(len(intrinsics.distortion) if intrinsics.distorts else 0)


def covered_path(intrinsics: Intrinsics, cover: Cover) -> tuple[Path, dict[str, Tensor]]:
    """Return the path of the camera behind its perfect, smooth cover, and its values. A cover of
    unknown shape is as none.
    """
    path, values = pinhole_path(intrinsics)
    if not find_shape(cover.shape).surface:
        return path, values
    covers = []
    for place, single in enumerate(cover.covers, 1):
        names = cover_names(place)
        shape = find_shape(single.shape)
        numbers = {name: number.value for name, number in single.parameters.items()}
        values |= {
            names.of(name): torch.tensor(number, dtype=torch.float64)
            for name, number in {**numbers, **shape.constants}.items()
        }
        surface: Surface = resolve_name(shape.surface)(names)
        origin = _full_names(names, shape.origin)
        frame = CoverFrame(origin, _tilt_names(names, shape, single))
        covers.append(SmoothCover(surface, frame, single.layers))
    return Path(path.lens, interfaces_of(*covers)), values


def with_relief(path: Path, relief: Relief, *, exact_hit: bool = True) -> Path:
    """Return the same path with an uneven outer surface, the outermost one of all.

    The values of this path must hold relief.amplitudes, of shape relief.grid.
    """
    *smooth, outer = path.cover
    uneven = replace(outer, relief=relief, exact_hit=exact_hit)
    return Path(path.lens, (*smooth, uneven), path.target)


def relief_over(
    path: Path,
    values: Values,
    region: tuple[tuple[float, float], tuple[float, float]],
    grid: tuple[int, int],
) -> Relief:
    """Return a relief of the outer surface for the glass between two chart coordinates, low and
    high, as the camera sees it at these values.
    """
    view = path.cover[-1].relief_view(values)
    return Relief.around(*region, grid, view.anchor, view.size)


def footprint(
    path: Path, values: Values, width: int, height: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the region of a relief, as its low and its high chart coordinates: the glass that an
    image of width x height px sees, and a margin around it.
    """
    columns = torch.linspace(-0.5, width - 0.5, LATTICE, dtype=torch.float64)
    rows = torch.linspace(-0.5, height - 0.5, LATTICE, dtype=torch.float64)
    pixels = torch.cartesian_prod(columns, rows)
    rays = path.trace(pixels, values, MIDDLE)
    outer = path.cover[-1]
    first, second = outer.surface.chart(outer.frame.at(values).enter(rays.origin))
    arrived = rays.failure == 0
    if not bool(arrived.any()):
        raise InputError(
            "cover: no ray of the camera leaves this cover; check its radius, offset and thickness"
            " in session.yaml."
        )
    first_low, first_high = _with_margin(first[arrived])
    second_low, second_high = _with_margin(second[arrived])
    return (first_low, second_low), (first_high, second_high)


def _with_margin(coordinates: Tensor) -> tuple[float, float]:
    """Return the range of these coordinates, widened by FOOTPRINT_MARGIN on both sides."""
    low, high = coordinates.min(), coordinates.max()
    margin = FOOTPRINT_MARGIN * (high - low)
    return float(low - margin), float(high + margin)


def _tilt_names(names: CoverNames, shape: Shape, cover: Cover) -> Names:
    """Return the names of the tilt's values about x, y and z; None for a tilt that is zero and not
    estimated, which saves its rotations.
    """
    tilt = [cover.parameters[f"tilt.{axis}"] for axis in shape.tilt_axes]
    if all(number.value == 0 and number.sigma == 0 for number in tilt):
        return None, None, None
    return (
        names.of("tilt.x") if "x" in shape.tilt_axes else None,
        names.of("tilt.y") if "y" in shape.tilt_axes else None,
        names.of("tilt.z") if "z" in shape.tilt_axes else None,
    )


def _full_names(names: CoverNames, numbers: Names) -> Names:
    """Return the names that the values of a path have for three numbers of a shape."""
    x, y, z = numbers
    return x and names.of(x), y and names.of(y), z and names.of(z)
