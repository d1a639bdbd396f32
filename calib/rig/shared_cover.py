"""One cover before several cameras: its numbers are those of the first camera, in whose frame it
stands.

A further camera behind it has a lens that is mounted in the first camera's frame: its rays are
moved there before they meet the glass. So one set of numbers, and one relief, serves all cameras,
and the ray path differentiates by the mountings as by any other number.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares
from torch import Tensor

from calib.calibration import Calibration
from calib.estimation.camera_model import CameraModel
from calib.optics.build import covered_path, footprint, relief_over
from calib.optics.exposure import MIDDLE
from calib.optics.lens import Lens, Pull, launch_by_autograd
from calib.optics.params import Param, Values
from calib.optics.path import Path
from calib.optics.rays import Rays
from calib.optics.relief import AMPLITUDES, Relief
from calib.optics.rotation import Rotation, matrix
from calib.optics.vector import Vector
from calib.rig.joint_estimate import CameraState
from calib.rig.layout import MOUNTING
from calib.session.camera import Camera
from calib.session.cover import Cover
from calib.session.numbers import replace_numbers
from calib.session.parameter_names import COVER, number_of

MOUNTING_SIGMA = 1e6
"""rad and m: the standard deviation of a mounting's prior, which says nothing."""
PLACE = ("distance", "tilt", "centre", "axis_offset", "inner_radius")
"""The numbers of a cover that differ from camera to camera: its place, and a cone's radius, which
is that at the camera's height.
"""
LATTICE = 9
"""The number of pixels along each side of the picture at which two covers are compared."""
HEIGHTS = 41
"""The number of pixels along each side of the picture at which two reliefs are compared."""
SMALLEST = 1e-6
"""The smallest singular value, over the largest, of a direction of the amplitudes that the heights
determine.
"""
DEPTHS = (0.3, 3.0)
"""m: the depths at which the places of their rays are compared."""
TOLERANCE = 1e-15
"""The tolerance of the fit of a cover's place: rounding."""
SCALE = 1e-3
"""m and rad: the size of a typical difference of a cover's place."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class MountedLens:
    """The lens of a camera, with its rays in the frame of the first camera behind the same
    cover.
    """

    lens: Lens
    camera: str
    """The name of the lens's camera, whose mounting is T_camera_reference."""
    first: str
    """The name of the first camera; empty if it is the reference."""

    @property
    def params(self) -> tuple[Param, ...]:
        names = [self.camera, *([self.first] if self.first else [])]
        return (*self.lens.params, *(mounting_param(name) for name in names))

    @property
    def pupil(self) -> tuple[Param, ...]:
        return self.lens.pupil

    @property
    def wide(self) -> bool:
        return self.lens.wide

    def with_pupil(self, pupil: tuple[Param, ...]) -> MountedLens:
        return replace(self, lens=self.lens.with_pupil(pupil))

    def __call__(self, pixels: Tensor, values: Values, near: Tensor | None = None, /) -> Rays:
        """Return the rays of (..., 2) px. `near` would be in another frame than the lens's, so it
        is not used.
        """
        del near
        rays = self.lens(pixels, values)
        turn, shift = self._from_reference(values, self.camera)
        direction = turn.turn(rays.direction, back=True)
        origin = turn.turn(rays.origin - shift, back=True)
        if self.first:
            turn, shift = self._from_reference(values, self.first)
            direction = turn.turn(direction)
            origin = turn.turn(origin) + shift
        return Rays(origin, direction, rays.failure)

    def launch(
        self, pixels: Tensor, values: Values, names: frozenset[str], near: Tensor | None = None, /
    ) -> tuple[Rays, Pull]:
        return launch_by_autograd(self, pixels, values, names, near)

    def project(self, points: Tensor, values: Values) -> Tensor:
        place = Vector.of(points)
        if self.first:
            turn, shift = self._from_reference(values, self.first)
            place = turn.turn(place - shift, back=True)
        turn, shift = self._from_reference(values, self.camera)
        return self.lens.project((turn.turn(place) + shift).stacked(), values)

    @staticmethod
    def _from_reference(values: Values, camera: str) -> tuple[Rotation, Vector]:
        mounting = values[mounting_param(camera).name]
        return Rotation.of(matrix(mounting[..., :3])), Vector.of(mounting[..., 3:])


def mounting_param(camera: str) -> Param:
    """Return the six numbers of a camera's mounting, rad and m."""
    return Param(f"{MOUNTING}.{camera}", "rad, m", 1.0, (6,))


def share_cover(
    name: str,
    model: CameraModel,
    first: str,
    first_model: CameraModel,
    mountings: Mapping[str, Tensor],
) -> CameraModel:
    """Return the model of a camera behind the cover of another one.

    Args:
        name: the camera.
        model: its own model, whose cover is not used.
        first: the first camera behind the cover; empty if it is the reference.
        first_model: its model.
        mountings: (6,) T_camera_reference of both, by name.
    """
    lens = MountedLens(model.path.lens, name, first)
    path = replace(model.path, lens=lens, cover=first_model.path.cover)
    names = [name, *([first] if first else [])]
    placed = {mounting_param(camera).name: mountings[camera] for camera in names}
    means = {key: value for key, value in model.means.items() if not is_of_cover(key)}
    means |= {key: value for key, value in first_model.means.items() if is_of_cover(key)}
    sigmas = {key: value for key, value in model.priors.sigmas.items() if not is_of_cover(key)}
    sigmas |= {key: v for key, v in first_model.priors.sigmas.items() if is_of_cover(key)}
    sigmas |= dict.fromkeys(placed, MOUNTING_SIGMA)
    correlations = {
        pair: value
        for pair, value in model.priors.correlations.items()
        if not any(map(is_of_cover, pair))
    }
    priors = replace(model.priors, sigmas=sigmas, correlations=correlations, glass=None)
    return replace(model, path=path, means={**means, **placed}, priors=priors)


def with_joined_relief(
    cameras: Sequence[CameraState], pictures: Sequence[Camera]
) -> list[CameraState]:
    """Return cameras behind one cover with one relief over the glass that all of them see. It
    starts as flat.

    Args:
        cameras: the first camera, and those behind the same cover.
        pictures: theirs, for the sizes of their pictures.
    """
    leader = cameras[0]
    first = leader.model.path.relief
    assert first
    regions = np.array(
        [
            footprint(camera.model.path, camera.values, picture.width, picture.height)
            for camera, picture in zip(cameras, pictures, strict=True)
        ]
    )
    low = regions[:, 0].min(0)
    high = regions[:, 1].max(0)
    region = (float(low[0]), float(low[1])), (float(high[0]), float(high[1]))
    relief = relief_over(leader.model.path, leader.values, region, first.grid)
    flat = {AMPLITUDES: torch.zeros(relief.grid, dtype=torch.float64)}
    joined = []
    for camera in cameras:
        *inner, outer = camera.model.path.cover
        path = replace(camera.model.path, cover=(*inner, replace(outer, relief=relief)))
        model = replace(camera.model, path=path, means={**camera.model.means, **flat})
        joined.append(replace(camera, model=model, values={**camera.values, **flat}))
    return joined


def cover_in_camera(
    camera: Camera, cover: Cover, path: Path, values: Values, mounting: Tensor
) -> Cover:
    """Return the numbers of a shared, even cover in a further camera's own frame: those whose rays
    are the same.

    Args:
        camera: the camera.
        cover: the cover in the first camera's frame.
        path: the path of the camera with its mounted lens.
        values: its values.
        mounting: (6,) T_camera_first.
    """
    intrinsics = camera.intrinsics
    assert intrinsics
    pixels = _lattice((camera.width, camera.height))
    even = replace(path, cover=tuple(replace(s, relief=None) for s in path.cover))
    rays = even.trace(pixels, values, MIDDLE)
    turn = Rotation.of(matrix(mounting[:3]))
    moved = Rays(
        turn.turn(rays.origin) + Vector.of(mounting[3:]), turn.turn(rays.direction), rays.failure
    )
    places = _places(moved)
    names = [name for name in cover.numbers if number_of(name).split(".")[0] in PLACE]
    start = np.array([cover.numbers[name].value for name in names])

    def moved_cover(point: Array) -> Cover:
        numbers = {
            name: replace(cover.numbers[name], value=float(value))
            for name, value in zip(names, start + SCALE * point, strict=True)
        }
        return replace_numbers(intrinsics, cover, numbers)[1]

    def off(point: Array) -> Array:
        own, own_values = covered_path(intrinsics, moved_cover(point))
        return np.nan_to_num((_places(own.trace(pixels, own_values, MIDDLE)) - places).ravel())

    solution = least_squares(
        off,
        np.zeros(len(names)),
        jac="3-point",
        xtol=TOLERANCE,
        ftol=TOLERANCE,
        gtol=TOLERANCE,
    )
    return moved_cover(solution.x)


def is_of_cover(name: str) -> bool:
    """True if a parameter of this name is one of a cover or of its relief."""
    return name == AMPLITUDES or name.startswith(COVER.part)


def _lattice(size: tuple[int, int], count: int = LATTICE) -> Tensor:
    axes = [torch.linspace(0, length - 1, count, dtype=torch.float64) for length in size]
    return torch.cartesian_prod(*axes)


def _places(rays: Rays) -> Array:
    """Return (N, 2, 2) m, where rays cross the planes of DEPTHS; NaN for a failed ray."""
    failed = (rays.failure != 0).unsqueeze(-1)
    depths = [torch.full_like(rays.origin.z, depth) for depth in DEPTHS]
    places = [torch.where(failed, torch.nan, rays.at_depth(depth)) for depth in depths]
    return torch.stack(places, 1).numpy()


def relief_in_camera(calibration: Calibration, path: Path, values: Values) -> tuple[Relief, Array]:
    """Return the relief of a shared cover in the chart of a further camera's own cover, and its
    (rows, columns) m amplitudes: those with the same heights where the camera's rays leave the
    glass.

    Args:
        calibration: the camera with its cover in its own frame, without a relief.
        path: the path of the camera with its mounted lens.
        values: its values.
    """
    camera = calibration.camera
    shared = path.cover[-1]
    assert shared.relief
    own, own_values = calibration.model()
    region = footprint(own, own_values, camera.width, camera.height)
    relief = relief_over(own, own_values, region, shared.relief.grid)
    pixels = _lattice((camera.width, camera.height), HEIGHTS)
    rays = path.trace(pixels, values, MIDDLE)
    point = shared.frame.at(values).enter(rays.origin)
    heights = shared.relief_height(point, values)
    own_rays = own.trace(pixels, own_values, MIDDLE)
    outer = replace(own.cover[-1], relief=relief)
    chart = outer.relief_chart(outer.frame.at(own_values).enter(own_rays.origin), own_values)

    first, _ = relief.gaussians(chart[0], 0)  # (rows, N)
    second, _ = relief.gaussians(chart[1], 1)  # (columns, N)
    basis = torch.einsum("rn,cn->nrc", first, second).flatten(1).numpy()
    arrived = ((rays.failure == 0) & (own_rays.failure == 0)).numpy()
    amplitudes = np.linalg.lstsq(basis[arrived], heights.numpy()[arrived], rcond=SMALLEST)[0]
    return relief, amplitudes.reshape(relief.grid)
