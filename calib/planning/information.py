"""What a view with the board in some pose would tell of the numbers that all views share, and what these do to the maps."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.linalg import block_diag
from torch import Tensor

from calib.corners.view import View
from calib.estimation.jacobians import undistorted_slopes
from calib.estimation.map_fit import FIRST_PRIOR, FIRST_SIGMA
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residual_blocks import landings, pixel_weights
from calib.estimation.stated_priors import freed
from calib.estimation.surface_prior import Smoothness, basis
from calib.fitting.stages import Settings, Setup, fit_stages
from calib.optics.build import covered_path, footprint, with_relief
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.projection import project
from calib.optics.relief import Relief
from calib.planning.design import Design
from calib.progress import Silent
from calib.session.board import Board
from calib.session.camera import Camera

Array = NDArray[np.float64]

FEWEST_FITTED = 4
"""Views from which on they are fitted; before, the cover is taken to be as described."""
NEGLIGIBLE = 3e-3
"""px: what modes that are left out may move the maps by, altogether."""


@dataclass(frozen=True, slots=True)
class Model:
    """A ray path with a relief, at the current estimate, and which of its numbers are estimated beside the relief."""

    path: Path
    values: Values
    free: Mapping[str, float]
    """The standard deviation of each free number's prior (SI units)."""

    @property
    def relief(self) -> Relief:
        relief = self.path.cover[-1].relief
        assert relief
        return relief

    @property
    def scales(self) -> dict[str, float]:
        return {param.name: param.scale for param in self.path.params if param.name in self.free}

    def information(self, observations: Observations, poses: Tensor) -> Array:
        """(V, S, S): what each view tells of the amplitudes and the free numbers over their scales, its pose eliminated, at 1 px of noise
        per axis."""
        views = []
        weights = pixel_weights(self.path, self.values, observations, poses, 1.0)
        begin = 0
        for landing in landings(self.path, self.values, observations, weights, tuple(self.scales), relief_moves=True):
            own = poses[begin : begin + len(landing.observations.names)]
            begin += len(own)
            at = landing.linearise(self.values, own, poses.new_tensor(list(self.scales.values())))
            for rows, by_pose in zip(
                landing.observations.per_view(at.jacobian_shared), landing.observations.per_view(at.jacobian_block), strict=True
            ):
                shared, pose = rows.flatten(0, 1), by_pose.flatten(0, 1)
                q = torch.linalg.qr(pose).Q  # (2 n, 6)
                rest = shared - q @ (q.mT @ shared)
                views.append((rest.mT @ rest).numpy())
        return np.array(views)

    def glass(self, pixels: Array) -> Array:
        """(N, 2) where on the relief's patch the rays of (N, 2) px leave the glass, down and across, each from 0 to 1."""
        outer = self.path.cover[-1]
        rays = self.path.trace(torch.from_numpy(pixels), self.values)
        at = torch.stack(outer.surface.chart(outer.frame.enter(rays.origin, self.values)), -1).numpy()
        low, high = np.array(self.relief.low), np.array(self.relief.high)
        return np.where((rays.failure != 0).numpy()[:, None], np.nan, (at - low) / (high - low))


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """What is the same for any strength of the prior and of the noise."""

    model: Model
    poses: Array
    """(P, 6)"""
    corners: Array
    """(P, count, 2) px"""
    information: Array
    """(P, S, S) at 1 px of noise per axis."""
    slopes: Array
    """(h, w, 2, 2, S), rigid motion taken out; NaN where there is no ray."""
    depths: Array
    """(D,) m"""
    glass: Array
    """(h, w, 2) where on the relief's patch these pixels' rays leave, each from 0 to 1."""

    def design(self, smoothness: Smoothness, sigma: float, seen: Array) -> Design:
        """For a prior, the noise in px per axis, and the (V, S, S) information of the views that there are, at 1 px."""
        scales = self.model.scales
        fixed = [self.model.free[name] / scale for name, scale in scales.items()]
        heights = np.linalg.solve(basis(self.model.relief), smoothness.root(self.model.relief))
        root = block_diag(heights, np.diag(fixed))  # of the prior's covariance
        at = np.stack([np.ones_like(self.depths), 1 / self.depths])
        moved = np.einsum("hwabs,ad->hwdbs", self.slopes, at) @ root
        rows = moved[np.isfinite(moved[..., 0, 0])]  # (n, 2, S)
        power, modes = np.linalg.eigh(np.einsum("nbr,nbs->rs", rows, rows) / len(rows))
        kept = np.cumsum(np.maximum(power, 0)) > NEGLIGIBLE**2
        root = root @ modes[:, kept]
        return Design(
            self.poses,
            self.corners,
            root.T @ self.information @ root / sigma**2,
            root.T @ seen.sum(0) @ root / sigma**2 if len(seen) else np.zeros((root.shape[1], root.shape[1])),
            len(seen),
            self.slopes @ root,
            self.depths,
            self.glass,
        )


def survey(model: Model, board: Board, camera: Camera, poses: Array, cells: tuple[int, int], depths: Array) -> Survey:
    """Look at every pose of a bank through the cover.

    Args:
        poses: (P, 6); those in which some corner would not be in the picture are dropped.
        cells: rows and columns of the picture in whose middles the maps are judged.
        depths: (D,) m, at which they are.
    """
    placed, points = torch.from_numpy(poses), torch.from_numpy(board.points())
    points = model.path.place(points.repeat(len(poses), 1), model.values, placed.repeat_interleave(board.count, 0))
    corners = project(model.path, model.values, points).numpy().reshape(len(poses), board.count, 2)
    inside = ((corners > 0) & (corners < [camera.width - 1, camera.height - 1])).all((1, 2))  # false for NaN
    poses, corners = poses[inside], corners[inside]
    views = tuple(View(str(index), seen, np.ones(board.count)) for index, seen in enumerate(corners))
    x, y = ((np.arange(n) + 0.5) / n * length - 0.5 for n, length in zip(cells[::-1], (camera.width, camera.height), strict=True))
    pixels = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    slopes, motions, lost = undistorted_slopes(model.path, model.values, model.scales, pixels)
    at = np.stack([np.ones_like(depths), 1 / depths])
    changed, moved = (np.einsum("nabs,ad->ndbs", part[~lost], at).reshape(-1, part.shape[-1]) for part in (slopes, motions))
    slopes = slopes - motions @ np.linalg.lstsq(moved, changed, rcond=None)[0]
    slopes[lost] = np.nan
    information = model.information(Observations.of(views, board), placed[torch.from_numpy(inside)])
    return Survey(model, poses, corners, information, slopes.reshape(*cells, 2, 2, -1), depths, model.glass(pixels).reshape(*cells, 2))


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """What some views tell: a fit of them, or the nominal cover where they are too few for one."""

    model: Model
    poses: Tensor
    """(V, 6) of these views."""
    observations: Observations
    smoothness: Smoothness
    sigma: float
    """px per axis"""

    def design(self, setup: Setup, poses: Array, cells: tuple[int, int], depths: Array) -> Design:
        """What each of (P, 6) poses would add; `cells` and `depths` are where the maps are judged, as in `survey`."""
        surveyed = survey(self.model, setup.board, setup.camera, poses, cells, depths)
        _, failed = self.model.path.land(self.observations.pixels, self.model.values, self.poses[self.observations.view])
        seen = self.observations.kept(failed == 0)
        information = self.model.information(seen, self.poses) if len(self.poses) else surveyed.information[:0]
        return surveyed.design(self.smoothness, self.sigma, information)


def estimate(setup: Setup, views: Sequence[View], grid: tuple[int, int]) -> Estimate:
    """The best that is known after some views, perhaps none; `grid` are the centres of the relief.

    Raises:
        NotEnoughDataError: the corners cannot be seen through the cover.
    """
    observations = Observations.of(views, setup.board)
    if len(views) >= FEWEST_FITTED:
        fitted = fit_stages(setup, observations, Settings(grid=grid), Silent())
        assert fitted.joint
        assert fitted.joint.smoothness
        model = Model(fitted.path, fitted.values, freed(setup.intrinsics, setup.cover, fitted.path))
        return Estimate(model, fitted.poses, observations, fitted.joint.smoothness, fitted.joint.sigma)
    path, values = covered_path(setup.intrinsics, setup.cover)
    relief = Relief(*footprint(path, values, setup.camera.width, setup.camera.height), grid)
    poses = pinhole_poses(observations, values)
    if views:
        poses = refine_poses(path, values, observations, poses).blocks
    path = with_relief(path, relief)
    values["relief.amplitudes"] = torch.zeros(grid, dtype=torch.float64)
    model = Model(path, values, freed(setup.intrinsics, setup.cover, path))
    return Estimate(model, poses, observations, FIRST_PRIOR, FIRST_SIGMA)
