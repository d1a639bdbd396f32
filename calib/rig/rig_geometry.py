"""The cameras of a rig as triangulation takes them, and what follows from their covariance."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.calibration import Calibration
from calib.estimation.camera_model import CameraModel
from calib.estimation.covariance import covariance_root
from calib.fitting.corner_range import corner_points
from calib.rig.gauge import gauge_motion, mounting_motion, point_motion, ray_motion
from calib.rig.layout import RigLayout
from calib.rig.placements import Indices
from calib.rig.poses import invert_poses, move_points, pose_matrix
from calib.rig.rig_content import Baseline, Mounting, RigContent
from calib.rig.shared_cover import share_cover
from calib.rig.triangulation import PlacedCamera, TriangulatedPoints, triangulate_points
from calib.threads import single_thread

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RigGeometry:
    """The cameras of a rig with the roots of its covariance."""

    names: tuple[str, ...]
    cameras: tuple[PlacedCamera, ...]
    """A camera behind a shared cover has the mounting of the first camera behind it, in whose frame
    its rays are.
    """
    mountings: Tensor
    """(C, 6) T_camera_reference."""
    mounting_columns: tuple[Indices, ...]
    """For each camera, (6,) the places of its mounting in the vector; (0,) for the reference."""
    root: Array
    """(S, Q) R with R R^T the covariance; Q is 0 without one."""
    gauge: Array
    """(6, S) `gauge_motion`."""
    ray_motions: tuple[Array, ...]
    """For each camera, (6, S) `ray_motion`."""

    def triangulate(self, pixels: Sequence[Array]) -> TriangulatedPoints:
        return triangulate_points(self.cameras, pixels, len(self.root))

    def errors_without_gauge(self, result: TriangulatedPoints) -> Array:
        """Return the (N, 3, Q) m errors of points for each independent error of unit variance."""
        motion = point_motion(result.points) @ self.gauge
        errors: Array = (result.by_numbers - motion) @ self.root
        return errors

    def distances(
        self, result: TriangulatedPoints, pairs: NDArray[np.intp], noise_px: float
    ) -> tuple[Array, Array]:
        """Return the (M,) m distances of (M, 2) pairs of points, and their standard deviations."""
        first, second = pairs[:, 0], pairs[:, 1]
        offset = result.points[second] - result.points[first]
        length = np.linalg.norm(offset, axis=-1)
        apart = (length > 0)[:, None]
        direction = np.where(apart, offset / np.where(apart, length[:, None], 1.0), 3**-0.5)
        direction = np.where(np.isnan(length)[:, None], np.nan, direction)
        by_numbers = result.by_numbers[second] - result.by_numbers[first]
        errors = np.einsum("mi,mis->ms", direction, by_numbers) @ self.root
        noise = np.where(
            (first == second)[:, None, None], 0.0, result.noise[first] + result.noise[second]
        )
        from_pixels = noise_px**2 * np.einsum("mi,mij,mj->m", direction, noise, direction)
        return length, np.sqrt((errors**2).sum(-1) + from_pixels)

    def mounting(self, index: int) -> Mounting:
        camera = self.cameras[index]
        count = len(self.root)
        reference = next(i for i, places in enumerate(self.mounting_columns) if not len(places))
        by_numbers, by_rays = np.zeros((6, count)), np.zeros((6, count))
        if index != reference:
            mounting = self.mountings[index]
            by_numbers[:, self.mounting_columns[index]] = mounting_motion(mounting)
            if len(camera.mounting_columns):
                by_rays[:, camera.mounting_columns] = mounting_motion(camera.mounting)
            to_camera = _adjoint(camera.mounting)
            by_rays += to_camera @ self.ray_motions[reference] - self.ray_motions[index]
        return Mounting(
            pose_matrix(self.mountings[index]), self._sigma(by_numbers), self._sigma(by_rays)
        )

    @property
    def baselines(self) -> tuple[Baseline, ...]:
        """The distances between all pairs of cameras."""
        count = len(self.names)
        return tuple(
            self.baseline(first, second)
            for first in range(count)
            for second in range(first + 1, count)
        )

    def baseline(self, first: int, second: int) -> Baseline:
        centres, slopes = [], []
        for index in (first, second):
            matrix = pose_matrix(self.mountings[index])
            columns = self.mounting_columns[index]
            centres.append(-matrix[:3, :3].T @ matrix[:3, 3])
            slope = np.zeros((3, len(self.root)))
            if len(columns):
                # A motion of everything outside by d moves the pinhole by -R^T d.
                motion = mounting_motion(self.mountings[index])
                slope[:, columns] = -matrix[:3, :3].T @ motion[3:]
            slopes.append(slope)
        offset = centres[1] - centres[0]
        length = float(np.linalg.norm(offset))
        direction = offset / max(length, 1e-12)
        sigma = self._sigma((direction @ (slopes[1] - slopes[0]))[None])
        return Baseline(self.names[first], self.names[second], length, float(sigma[0]))

    def _sigma(self, by_numbers: Array) -> Array:
        return np.asarray(np.linalg.norm(by_numbers @ self.root, axis=-1))


@lru_cache(maxsize=4)
def rig_geometry(rig: RigContent) -> RigGeometry:
    """Return the cameras of a rig as triangulation takes them, with the roots of its covariance."""
    models = rig_models(rig.calibrations, rig.reference, rig.covers, rig.mountings)
    layout = RigLayout.of(rig.names, models, rig.reference, rig.covers, rig.media)
    cameras = tuple(
        PlacedCamera(
            model.path,
            model.means,
            model.parameters,
            layout.columns[index].numpy(),
            torch.from_numpy(rig.mountings[layout.frames[index]]),
            layout.mountings[layout.frames[index]].numpy(),
        )
        for index, model in enumerate(models)
    )
    mountings = torch.from_numpy(rig.mountings)
    mounting_columns = tuple(entries.numpy() for entries in layout.mountings)
    if not rig.covariance.size:
        empty = np.zeros((6, layout.count))
        return RigGeometry(
            names=rig.names,
            cameras=cameras,
            mountings=mountings,
            mounting_columns=mounting_columns,
            root=np.zeros((layout.count, 0)),
            gauge=empty,
            ray_motions=(empty,) * len(cameras),
        )
    pixels = [c.observations.pixels.numpy() for c in rig.calibrations.values()]
    points = []
    for index, calibration in enumerate(rig.calibrations.values()):
        in_camera = torch.from_numpy(corner_points(calibration))
        to_reference = invert_poses(mountings[index])
        placed = move_points(cameras[index].mounting, move_points(to_reference, in_camera))
        points.append(placed.numpy())
    with single_thread():
        return RigGeometry(
            names=rig.names,
            cameras=cameras,
            mountings=mountings,
            mounting_columns=mounting_columns,
            root=covariance_root(rig.covariance),
            gauge=gauge_motion(cameras, pixels, points, layout.count),
            ray_motions=tuple(
                ray_motion(camera, corners, places, layout.count)
                for camera, corners, places in zip(cameras, pixels, points, strict=True)
            ),
        )


def rig_models(
    calibrations: Mapping[str, Calibration],
    reference: str,
    covers: Mapping[str, str],
    mountings: Array,
) -> list[CameraModel]:
    """Return the models of the cameras, with the covers that they share."""
    models = {name: calibration.camera_model() for name, calibration in calibrations.items()}
    placed = dict(zip(calibrations, torch.from_numpy(mountings), strict=True))
    for name, first in covers.items():
        frame = "" if first == reference else first
        models[name] = share_cover(name, models[name], frame, models[first], placed)
    return list(models.values())


def placed_cameras(rig: RigContent) -> tuple[PlacedCamera, ...]:
    """Return the cameras of a rig as triangulation takes them."""
    return rig_geometry(rig).cameras


def _adjoint(mounting: Tensor) -> Array:
    """Return the (6, 6) matrix from a small motion in the reference's frame to that in a camera's
    frame.
    """
    matrix = pose_matrix(mounting)
    turn = matrix[:3, :3]
    x, y, z = matrix[:3, 3]
    adjoint = np.zeros((6, 6))
    adjoint[:3, :3] = turn
    adjoint[3:, 3:] = turn
    adjoint[3:, :3] = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn
    return adjoint
