"""Points from the pixels of several cameras behind covers, and how they move with the calibration.

A point is the one whose projections, through lens and glass, are nearest to its pixels: the sum of
the squared distances in the pictures is least. A disparity formula does not hold behind a cover,
whose rays do not meet in one point. The implicit function theorem gives the derivatives: the ray of
the projected pixel passes through the point.

Source: R. I. Hartley, P. Sturm, Triangulation (1997), for the criterion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.apply.map_uncertainty import frames_along
from calib.estimation.jacobians import undistorted_jacobian
from calib.estimation.parameters import Parameters
from calib.optics.exposure import MIDDLE
from calib.optics.lens import PIXELS
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.projection import project
from calib.optics.rotation import Rotation, left_jacobian, matrix
from calib.rig.poses import cross_matrix, move_points
from calib.session.parameter_names import CAMERA

MAX_STEPS = 12
"""The limit on Gauss-Newton steps to a point. From the nearest point of the rays, three are enough
unless the rays hardly converge.
"""
STEP_TOLERANCE = 1e-9
"""The length of the last step, as a fraction of the point's distance."""
PARALLEL = 1e12
"""The condition number from which rays count as parallel."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class PlacedCamera:
    """A camera of a rig at the optimum of its fit."""

    path: Path
    values: Values
    parameters: Parameters
    """The estimated parameters, with the optimum as their origin."""
    columns: NDArray[np.int64]
    """(S_c,) the places of these parameters in the vector of the rig."""
    mounting: Tensor
    """(6,) T_camera_reference."""
    mounting_columns: NDArray[np.int64]
    """(6,) the places of the mounting in the vector of the rig; (0,) for the reference."""

    def project(self, points: Tensor, start: Tensor | None = None) -> Tensor:
        """Return the (N, 2) px of (N, 3) m points in the reference's frame; NaN where the camera
        sees none. `start` are (N, 2) px to start from.
        """
        in_camera = move_points(self.mounting, points)
        return project(self.path, self.values, in_camera, MIDDLE, start=start)

    def rays(self, pixels: Tensor) -> tuple[Tensor, Tensor]:
        """Return the (N, 3) m origins and (N, 3) unit directions of the rays of (N, 2) px in the
        reference's frame; NaN where there is none.
        """
        rays = self.path.trace(pixels, self.values, MIDDLE)
        failed = (rays.failure != 0).unsqueeze(-1)
        turn = matrix(self.mounting[:3])
        origins = (rays.origin.stacked() - self.mounting[3:]) @ turn
        directions = rays.direction.stacked() @ turn
        return torch.where(failed, torch.nan, origins), torch.where(failed, torch.nan, directions)

    def by_point(self, pixels: Tensor, points: Tensor) -> Tensor:
        """Return the (N, 2, 3) derivatives of the (N, 2) px of (N, 3) m points by the points."""
        by_point, _, _ = self._differentiate(pixels, points)
        return by_point @ matrix(self.mounting[:3])

    def by_numbers(self, pixels: Tensor, points: Tensor, count: int) -> Array:
        """Return the (N, 2, S) derivatives of the (N, 2) px of (N, 3) m points by the vector of the
        rig, which has S = `count` entries.
        """
        by_point, by_plane, frames = self._differentiate(pixels, points)
        columns = np.zeros((len(pixels), 2, count))
        in_camera = move_points(self.mounting, points)
        jacobian, _, invalid = undistorted_jacobian(
            self.path, self.parameters, pixels.numpy(), frames
        )
        depth = _in_frames(frames, in_camera)[:, 2].numpy()[:, None, None]
        focal = np.array([float(self.values[name]) for name in CAMERA.focal])[:, None]
        # How far the ray moves in the plane of the point's depth, m.
        moves = (depth * jacobian[:, 0] + jacobian[:, 1]) / focal
        moves[invalid] = np.nan
        columns[..., self.columns] = -np.linalg.inv(by_plane.numpy()) @ moves
        if len(self.mounting_columns):
            arm = in_camera - self.mounting[3:]
            by_mounting = torch.cat(
                [-cross_matrix(arm) @ left_jacobian(self.mounting[:3]), _eye(arm)], -1
            )
            columns[..., self.mounting_columns] += (by_point @ by_mounting).numpy()
        return columns

    def _differentiate(self, pixels: Tensor, points: Tensor) -> tuple[Tensor, Tensor, Array | None]:
        """Return the (N, 2, 3) derivatives of pixels by points in the camera frame, the (N, 2, 2) m
        derivatives by the pixel of where its ray crosses the plane of the point's depth, and the
        frames in which that depth is taken; None for the camera frame.
        """
        in_camera = move_points(self.mounting, points)
        frames = None
        if self.path.lens.wide:
            directions = in_camera / in_camera.norm(dim=-1, keepdim=True)
            frames = frames_along(directions.numpy())
        depth = _in_frames(frames, in_camera)[:, 2]
        frame = None if frames is None else Rotation.of(torch.from_numpy(frames))
        trace = self.path.trace_with_derivatives(pixels, self.values, MIDDLE, frozenset())
        rays = trace.rays.rotate(frame) if frame else trace.rays
        by_rays = rays.at_depth_derivatives(depth)
        by_pixel = trace.pull(by_rays.turned(frame) if frame else by_rays)[PIXELS].transpose(0, 1)
        direction = rays.direction.stacked()
        slope = direction[:, :2] / direction[:, 2:]
        by_place = torch.cat(
            [torch.eye(2).to(slope).expand(len(slope), 2, 2), -slope[..., None]], -1
        )
        by_point = torch.linalg.inv_ex(by_pixel).inverse @ by_place
        if frames is not None:
            by_point = by_point @ torch.from_numpy(frames)
        return by_point, by_pixel, frames


@dataclass(frozen=True, slots=True, eq=False)
class TriangulatedPoints:
    """Points with the derivatives of their estimate."""

    points: Array
    """(N, 3) m in the reference's frame; NaN where fewer than two cameras see a point, or their
    rays do not meet.
    """
    noise: Array
    """(N, 3, 3) m^2 / px^2: the covariance from pixels of unit noise."""
    by_numbers: Array
    """(N, 3, S) the derivatives by the vector of the rig."""


def triangulate_points(
    cameras: Sequence[PlacedCamera], pixels: Sequence[Array], count: int
) -> TriangulatedPoints:
    """Return the points that project nearest to their pixels.

    Args:
        cameras: C cameras.
        pixels: for each camera (N, 2) px, NaN where it does not see the point.
        count: S, the length of the rig's vector.
    """
    observed = torch.from_numpy(np.stack(pixels))  # (C, N, 2)
    points, normal = _solve(cameras, observed)
    size = len(points)
    is_finite = torch.isfinite(points[:, 0])
    noise, by_numbers = np.full((size, 3, 3), np.nan), np.full((size, 3, count), np.nan)
    if bool(is_finite.any()):
        rows = is_finite.nonzero().squeeze(-1)
        covariance = torch.linalg.inv(normal[rows]).numpy()
        pull = np.zeros((len(rows), 3, count))
        for camera, camera_pixels in zip(cameras, observed[:, rows], strict=True):
            used = torch.isfinite(camera_pixels[:, 0])
            if not bool(used.any()):
                continue
            place = points[rows][used]
            projected = camera.project(place, camera_pixels[used])
            by_point = camera.by_point(projected, place).numpy()
            change = camera.by_numbers(projected, place, count)
            pull[used.numpy()] += by_point.swapaxes(1, 2) @ change
        noise[rows.numpy()] = covariance
        by_numbers[rows.numpy()] = -covariance @ pull
    return TriangulatedPoints(points.numpy(), noise, by_numbers)


def solve_points(cameras: Sequence[PlacedCamera], pixels: Sequence[Array]) -> Array:
    """Return the (N, 3) m points of `triangulate_points` without their derivatives."""
    return _solve(cameras, torch.from_numpy(np.stack(pixels)))[0].numpy()


def _solve(cameras: Sequence[PlacedCamera], observed: Tensor) -> tuple[Tensor, Tensor]:
    """Return the (N, 3) m points for (C, N, 2) px, NaN where there is none, and their (N, 3, 3)
    normal matrices.
    """
    points = _nearest_points(cameras, observed)
    normal = torch.full((*points.shape, 3), torch.nan, dtype=torch.float64)
    active = torch.isfinite(points[:, 0])
    for _ in range(MAX_STEPS):
        rows = active.nonzero().squeeze(-1)
        if not len(rows):
            break
        hessian = points.new_zeros(len(rows), 3, 3)
        gradient = points.new_zeros(len(rows), 3)
        failed = torch.zeros(len(rows), dtype=torch.bool)
        for camera, pixels in zip(cameras, observed[:, rows], strict=True):
            used = torch.isfinite(pixels[:, 0])
            place = points[rows][used]
            projected = camera.project(place, pixels[used])
            jacobian = camera.by_point(projected, place)
            residual = pixels[used] - projected
            hessian[used] += jacobian.mT @ jacobian
            gradient[used] += (jacobian.mT @ residual.unsqueeze(-1)).squeeze(-1)
            failed[used] |= ~torch.isfinite(projected[:, 0])
        steps, singular = torch.linalg.solve_ex(hessian, gradient)
        failed |= (singular != 0) | ~torch.isfinite(steps).all(-1)
        points[rows] = torch.where(failed[:, None], torch.nan, points[rows] + steps)
        normal[rows] = hessian
        size = points[rows].norm(dim=-1)
        active[rows] = ~failed & (steps.norm(dim=-1) > STEP_TOLERANCE * size)
    points[active] = torch.nan  # the steps do not end
    return points, normal


def _nearest_points(cameras: Sequence[PlacedCamera], observed: Tensor) -> Tensor:
    """Return the (N, 3) m points nearest to the rays of (C, N, 2) px; NaN where fewer than two
    cameras have a ray, or the rays are parallel or meet behind a camera.
    """
    size = observed.shape[1]
    system = torch.zeros(size, 3, 3, dtype=torch.float64)
    right_side = torch.zeros(size, 3, dtype=torch.float64)
    count = torch.zeros(size, dtype=torch.int64)
    traced = []
    for camera, pixels in zip(cameras, observed, strict=True):
        has_pixel = torch.isfinite(pixels).all(-1, keepdim=True)
        origins, directions = camera.rays(torch.where(has_pixel, pixels, 0.0))
        used = has_pixel.squeeze(-1) & torch.isfinite(origins[:, 0])
        origins = torch.where(used[:, None], origins, 0.0)
        directions = torch.where(used[:, None], directions, 0.0)
        projector = _eye(origins) - directions[:, :, None] * directions[:, None, :]
        projector = torch.where(used[:, None, None], projector, 0.0)
        system += projector
        right_side += (projector @ origins.unsqueeze(-1)).squeeze(-1)
        count += used
        traced.append((origins, directions, used))
    parallel = ~(torch.linalg.cond(system) < PARALLEL)
    solved, singular = torch.linalg.solve_ex(system, right_side)
    bad = (count < 2) | parallel | (singular != 0)
    for origins, directions, used in traced:
        bad |= used & (((solved - origins) * directions).sum(-1) <= 0)
    return torch.where(bad[:, None], torch.nan, solved)


def _eye(rows: Tensor) -> Tensor:
    return torch.eye(3).to(rows).expand(len(rows), 3, 3)


def _in_frames(frames: Array | None, points: Tensor) -> Tensor:
    if frames is None:
        return points
    return (torch.from_numpy(frames) @ points.unsqueeze(-1)).squeeze(-1)
