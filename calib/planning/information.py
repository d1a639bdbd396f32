"""What a view with the board in some pose would tell of the shared parameters, and what these do to
the maps.

A view's Fisher information J^T J / sigma^2, with its own pose eliminated, adds to that of the views
that are there. The maps' error is the Jacobian of the undistorted positions times the parameters'
error; a rigid motion of all rays, the gauge, is projected out of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.estimation.camera_model import CameraModel
from calib.estimation.elimination import information, view_equations
from calib.estimation.jacobians import undistorted_jacobian
from calib.estimation.joint_fit import FIRST_SIGMA
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.stated_priors import priors_of
from calib.estimation.surface_prior import Smoothness
from calib.fitting.stages import Settings, Setup, fit_stages
from calib.optics.build import covered_path, footprint, with_relief
from calib.optics.projection import project
from calib.optics.relief import Relief
from calib.planning.design import Design
from calib.planning.pose_bank import enough_seen, in_picture
from calib.progress import Silent
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.tolerances import GLASS_FIGURE

Array = NDArray[np.float64]

FEWEST_FITTED = 4
"""Views from which on they are fitted; before, the cover is taken to be as described."""
UNSEEN_GLASS = Smoothness(height=GLASS_FIGURE.sigma, length=0.4)
"""What a cover's glass may be like before any view has shown it."""
NEGLIGIBLE = 3e-3
"""px: what modes that are left out may move the maps by, altogether."""


def view_information(model: CameraModel, observations: Observations, poses: Tensor) -> Array:
    """(V, S, S): what each view tells of the model's parameters, its pose unknown, at 1 px of noise
    per axis.
    """
    parameters = model.parameters
    return information(
        view_equations(model.path, parameters, observations, poses, 1.0), parameters.count
    )


def on_patch(model: CameraModel, pixels: Array) -> Array:
    """(N, 2) where on the relief's patch the rays of (N, 2) px leave the glass, down and across,
    each from 0 to 1.
    """
    outer = model.path.cover[-1]
    assert outer.relief
    rays = model.path.trace(torch.from_numpy(pixels), model.means)
    at = torch.stack(
        outer.surface.chart(outer.frame.at(model.means).enter(rays.origin)), -1
    ).numpy()
    low, high = np.array(outer.relief.low), np.array(outer.relief.high)
    return np.where((rays.failure != 0).numpy()[:, None], np.nan, (at - low) / (high - low))


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """What is the same for any strength of the prior and of the noise."""

    model: CameraModel
    poses: Array
    """(P, 6)"""
    corners: Array
    """(P, count, 2) px, NaN where not seen."""
    information: Array
    """(P, S, S) at 1 px of noise per axis."""
    jacobian: Array
    """(h, w, 2, 2, S) of A and B (px, px m), rigid motion projected out; NaN where there is no ray.
    """
    depths: Array
    """(D,) m"""
    glass: Array
    """(h, w, 2) where on the relief's patch these pixels' rays leave, each from 0 to 1."""

    def design(self, smoothness: Smoothness, sigma: float, seen: Array) -> Design:
        """For a prior, the noise in px per axis, and the (V, S, S) information of the views that
        there are, at 1 px.
        """
        root = self.model.parameters.prior_root(smoothness)
        at = np.stack([np.ones_like(self.depths), 1 / self.depths])
        moved = np.einsum("hwabs,ad->hwdbs", self.jacobian, at) @ root
        rows = moved[np.isfinite(moved[..., 0, 0])]  # (n, 2, S)
        power, modes = np.linalg.eigh(np.einsum("nbr,nbs->rs", rows, rows) / len(rows))
        kept = np.cumsum(np.maximum(power, 0)) > NEGLIGIBLE**2
        root = root @ modes[:, kept]
        return Design(
            self.poses,
            self.corners,
            root.T @ self.information @ root / sigma**2,
            (
                root.T @ seen.sum(0) @ root / sigma**2
                if len(seen)
                else np.zeros((root.shape[1], root.shape[1]))
            ),
            len(seen),
            self.jacobian @ root,
            self.depths,
            self.glass,
        )


def survey(
    model: CameraModel,
    board: Board,
    camera: Camera,
    poses: Array,
    cells: tuple[int, int],
    depths: Array,
) -> Survey:
    """Look at every pose of a bank through the cover.

    Args:
        poses: (P, 6); those in which some corner would not be in the picture are dropped, of a
            board with markers those in which few would.
        cells: rows and columns of the picture in whose middles the maps are judged.
        depths: (D,) m, at which they are.
    """
    placed, points = torch.from_numpy(poses), torch.from_numpy(board.points())
    points = model.path.place(
        points.repeat(len(poses), 1), model.means, placed.repeat_interleave(board.count, 0)
    )
    corners = project(model.path, model.means, points).numpy().reshape(len(poses), board.count, 2)
    corners = in_picture(corners, camera)
    enough = enough_seen(corners, board)
    poses, corners = poses[enough], corners[enough]
    views = tuple(
        View(str(index), seen, np.isfinite(seen[:, 0]).astype(np.float64))
        for index, seen in enumerate(corners)
    )
    x, y = (
        (np.arange(n) + 0.5) / n * length - 0.5
        for n, length in zip(cells[::-1], (camera.width, camera.height), strict=True)
    )
    pixels = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    jacobian, motions, lost = undistorted_jacobian(model.path, model.parameters, pixels)
    at = np.stack([np.ones_like(depths), 1 / depths])
    changed, moved = (
        np.einsum("nabs,ad->ndbs", part[~lost], at).reshape(-1, part.shape[-1])
        for part in (jacobian, motions)
    )
    jacobian = jacobian - motions @ np.linalg.lstsq(moved, changed, rcond=None)[0]
    jacobian[lost] = np.nan
    informed = view_information(
        model, Observations.of(views, board), placed[torch.from_numpy(enough)]
    )
    return Survey(
        model,
        poses,
        corners,
        informed,
        jacobian.reshape(*cells, 2, 2, -1),
        depths,
        on_patch(model, pixels).reshape(*cells, 2),
    )


@dataclass(frozen=True, slots=True, eq=False)
class PlanningFit:
    """What some views tell: a fit of them, or the nominal cover where they are too few for one."""

    model: CameraModel
    poses: Tensor
    """(V, 6) of these views."""
    observations: Observations
    smoothness: Smoothness
    sigma: float
    """px per axis"""

    def design(self, setup: Setup, poses: Array, cells: tuple[int, int], depths: Array) -> Design:
        """What each of (P, 6) poses would add; `cells` and `depths` are where the maps are judged,
        as in `survey`.
        """
        surveyed = survey(self.model, setup.board, setup.camera, poses, cells, depths)
        _, failed = self.model.path.land(
            self.observations.pixels, self.model.means, self.poses[self.observations.view]
        )
        seen = self.observations.select_rows(failed == 0)
        known = (
            view_information(self.model, seen, self.poses)
            if len(self.poses)
            else surveyed.information[:0]
        )
        return surveyed.design(self.smoothness, self.sigma, known)


def estimate(setup: Setup, views: Sequence[View], grid: tuple[int, int]) -> PlanningFit:
    """The best that is known after some views, perhaps none; `grid` are the centres of the relief.

    Raises:
        NotEnoughDataError: the corners cannot be seen through the cover.
    """
    observations = Observations.of(views, setup.board)
    if len(views) >= FEWEST_FITTED:
        fitted = fit_stages(setup, observations, Settings(grid=grid), Silent())
        assert fitted.joint
        assert fitted.joint.smoothness
        model = CameraModel(
            fitted.path, fitted.values, priors_of(setup.intrinsics, setup.cover, fitted.path)
        )
        return PlanningFit(
            model, fitted.poses, observations, fitted.joint.smoothness, fitted.joint.sigma
        )
    path, values = covered_path(setup.intrinsics, setup.cover)
    relief = Relief(*footprint(path, values, setup.camera.width, setup.camera.height), grid)
    poses = pinhole_poses(observations, values)
    if views:
        poses = refine_poses(path, values, observations, poses).blocks
    path = with_relief(path, relief)
    values["relief.amplitudes"] = torch.zeros(grid, dtype=torch.float64)
    model = CameraModel(path, values, priors_of(setup.intrinsics, setup.cover, path))
    return PlanningFit(model, poses, observations, UNSEEN_GLASS, FIRST_SIGMA)
