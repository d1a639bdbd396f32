"""Functions that build a ray path and its parameters from the description in a session."""

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
from calib.optics.splined_fisheye import GRID, SHIFTS, Grid, SplinedFisheye
from calib.optics.surface import Surface
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.lens import FISHEYE, NAMES, OPENCV
from calib.session.parameter_names import CAMERA, COVER

FOOTPRINT_MARGIN = 0.2
"""The margin of the relief's patch on each side, as a fraction of the patch that the image sees.
Without centres outside that patch a sum of Gaussians falls off towards its edge, and cannot
represent, say, a constant thickness error (the bumps fixture then has 0.060 px, not 0.030).
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
        values[GRID] = Grid(spline.size, (spline.columns, spline.rows)).encoded
    return Path(lens_of(values)), values


def lens_of(values: Values) -> Lens:
    """Return the lens whose parameters are among the values of a path."""
    if GRID in values:
        return SplinedFisheye(Grid.of(values))
    if CAMERA.of(NAMES[FISHEYE][0]) in values:
        return Fisheye()
    return LensModel(sum(CAMERA.of(name) in values for name in NAMES[OPENCV]))


def covered_path(intrinsics: Intrinsics, cover: Cover) -> tuple[Path, dict[str, Tensor]]:
    """Return the path of the camera behind its perfect, smooth cover, and its values."""
    path, values = pinhole_path(intrinsics)
    if cover.shape == "none":
        return path, values
    parameters = {
        COVER.of(name): torch.tensor(number.value, dtype=torch.float64)
        for name, number in cover.parameters.items()
    }
    if cover.shape == "cylinder":
        parameters["cover.radius_slope"] = torch.zeros((), dtype=torch.float64)
    surface, frame = _surface_in_frame(cover)
    return (
        Path(path.lens, (Interface("inner", surface, frame), Interface("outer", surface, frame))),
        values | parameters,
    )


def with_relief(path: Path, relief: Relief, *, exact_hit: bool = True) -> Path:
    """Return the same path with an uneven outer surface.

    The values of this path must hold relief.amplitudes, of shape relief.grid.
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
    """Return the relief's patch, as its low and its high chart coordinates: the patch of glass that
    an image of width x height px sees, and a margin around it.
    """
    columns = torch.linspace(-0.5, width - 0.5, LATTICE, dtype=torch.float64)
    rows = torch.linspace(-0.5, height - 0.5, LATTICE, dtype=torch.float64)
    pixels = torch.cartesian_prod(columns, rows)
    rays = path.trace(pixels, values)
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


def _surface_in_frame(cover: Cover) -> tuple[Surface, CoverFrame]:
    """Return the cover's surface and the frame that it stands in.

    Every shape of calib.session.cover.SHAPES that has glass has a case here.
    """
    match cover.shape:
        case "cone" | "cylinder":
            return Cone(), CoverFrame(origin=_names(cover, "axis_offset"), tilt=_tilt_names(cover))
        case "flat":
            # Turned about the point of its inner face on the optical axis, so the distance along
            # that axis stays.
            frame = CoverFrame(origin=(None, None, "cover.distance"), tilt=_tilt_names(cover))
            return Flat(), frame
        case "dome":
            return Dome(), CoverFrame(origin=_names(cover, "centre"))
        case shape:
            raise ValueError(f"{shape!r} is not a shape of calib.session.cover.SHAPES")


def _names(cover: Cover, key: str) -> Names:
    """Return the names of the values that hold a vector's x, y and z; None for a component that the
    shape does not have.
    """
    return _name(cover, f"{key}.x"), _name(cover, f"{key}.y"), _name(cover, f"{key}.z")


def _name(cover: Cover, key: str) -> str | None:
    return COVER.of(key) if key in cover.parameters else None


def _tilt_names(cover: Cover) -> Names:
    """Return the tilt's names; None for a tilt that is zero and not estimated, which saves its
    rotations.
    """
    tilt = [number for name, number in cover.parameters.items() if name.startswith("tilt.")]
    return (
        (None, None, None)
        if all(number.value == 0 and number.sigma == 0 for number in tilt)
        else _names(cover, "tilt")
    )
