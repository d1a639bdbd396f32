"""The information of a view with the board in some pose about the shared parameters, and the effect
of these on the maps.

A view's Fisher information J^T J / sigma^2, with its own pose eliminated, adds to that of the
existing views. The maps' error is the Jacobian of the undistorted positions times the parameters'
error; a rigid motion of all rays, the gauge, is projected out of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.estimation.camera_model import CameraModel
from calib.estimation.jacobians import undistorted_jacobian
from calib.estimation.joint_fit import FIRST_SIGMA
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import reach_board
from calib.estimation.stated_priors import priors_of
from calib.estimation.surface_prior import Smoothness
from calib.estimation.view_equations import information, view_equations
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.optics.build import covered_path, footprint, relief_over, with_relief
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.planning.design import Design
from calib.planning.pose_bank import has_enough_corners, mask_to_picture
from calib.progress import Silent
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.cover import UNEVEN
from calib.session.tolerances import GLASS_FIGURE

Array = NDArray[np.float64]

MIN_FITTED_VIEWS = 4
"""From this number of views on they are fitted; with fewer, the cover is taken as described."""
PRIOR_GLASS = Smoothness(height=GLASS_FIGURE.sigma, length=0.4)
"""The smoothness of a cover's glass before any view."""
NEGLIGIBLE = 3e-3
"""px: the largest movement of the maps by all neglected modes together."""


def view_information(model: CameraModel, observations: Observations, poses: Tensor) -> Array:
    """Return each view's (V, S, S) information about the model's parameters, its pose eliminated,
    at 1 px of noise per axis.
    """
    parameters = model.parameters
    return information(
        view_equations(model.path, parameters, observations, poses, 1.0), parameters.count
    )


def patch_coordinates(model: CameraModel, pixels: Array) -> Array:
    """Return the (N, 2) points of the relief's region where the rays of (N, 2) px leave the glass,
    down and to the right, each from 0 to 1.
    """
    outer = model.path.cover[-1]
    assert outer.relief
    rays = model.path.trace(torch.from_numpy(pixels), model.means, MIDDLE)
    chart = outer.relief_chart(outer.frame.at(model.means).enter(rays.origin), model.means)
    points = torch.stack(chart, -1).numpy()
    low, high = map(np.array, outer.relief.region)
    return np.where((rays.failure != 0).numpy()[:, None], np.nan, (points - low) / (high - low))


@dataclass(frozen=True, slots=True, eq=False)
class Survey:
    """The part of a design that does not depend on the strength of the prior and of the noise."""

    model: CameraModel
    poses: Array
    """(P, 6)"""
    corners: Array
    """(P, count, 2) px, NaN where not visible."""
    information: Array
    """(P, S, S) information of each pose at 1 px of noise per axis."""
    jacobian: Array
    """(h, w, 2, 2, S) derivatives of A and B (px, px m), with rigid motion projected out; NaN where
    there is no ray.
    """
    depths: Array
    """(D,) m"""
    glass: Array
    """(h, w, 2) the points of the relief's region where the rays of these pixels leave, each from 0
    to 1.
    """

    def design(self, smoothness: Smoothness, sigma: float, existing: Array) -> Design:
        """Return the design for a prior, a noise in px per axis, and the (V, S, S) information of
        the existing views at 1 px.
        """
        root = self.model.parameters.prior_root(smoothness)
        powers = np.stack([np.ones_like(self.depths), 1 / self.depths])
        derivatives = np.einsum("hwabs,ad->hwdbs", self.jacobian, powers) @ root
        rows = derivatives[np.isfinite(derivatives[..., 0, 0])]  # (n, 2, S)
        power, modes = np.linalg.eigh(np.einsum("nbr,nbs->rs", rows, rows) / len(rows))
        selected = np.cumsum(np.maximum(power, 0)) > NEGLIGIBLE**2
        root = root @ modes[:, selected]
        initial_information = (
            root.T @ existing.sum(0) @ root / sigma**2
            if len(existing)
            else np.zeros((root.shape[1], root.shape[1]))
        )
        return Design(
            poses=self.poses,
            corners=self.corners,
            information=root.T @ self.information @ root / sigma**2,
            initial_information=initial_information,
            views=len(existing),
            spread=self.jacobian @ root,
            depths=self.depths,
            glass=self.glass,
        )


def survey(
    model: CameraModel,
    board: Board,
    camera: Camera,
    poses: Array,
    cells: tuple[int, int],
    depths: Array,
) -> Survey:
    """Project the board in every pose of a bank through the cover, and compute the information.

    Args:
        poses: (P, 6); a pose is dropped if some corner is not in the picture, for a board with
            markers if too few are.
        cells: rows and columns of the picture, in whose middles the maps are evaluated.
        depths: (D,) m, at which the maps are evaluated.
    """
    all_poses, points = torch.from_numpy(poses), torch.from_numpy(board.points())
    points = model.path.place(
        points.repeat(len(poses), 1),
        model.means,
        all_poses.repeat_interleave(board.count, 0),
        MIDDLE,
    )
    projected = project(model.path, model.means, points, MIDDLE)
    corners = projected.numpy().reshape(len(poses), board.count, 2)
    corners = mask_to_picture(corners, camera)
    enough = has_enough_corners(corners, board)
    poses, corners = poses[enough], corners[enough]
    views = tuple(
        View(str(index), view_corners, np.isfinite(view_corners[:, 0]).astype(np.float64))
        for index, view_corners in enumerate(corners)
    )
    rows, columns = cells
    x = (np.arange(columns) + 0.5) / columns * camera.width - 0.5
    y = (np.arange(rows) + 0.5) / rows * camera.height - 0.5
    pixels = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    jacobian, motions, failed = undistorted_jacobian(model.path, model.parameters, pixels)
    gauge = np.linalg.lstsq(
        _at_depths(motions[~failed], depths), _at_depths(jacobian[~failed], depths), rcond=None
    )[0]
    jacobian = jacobian - motions @ gauge
    jacobian[failed] = np.nan
    observations = Observations.of(views, board)
    return Survey(
        model=model,
        poses=poses,
        corners=corners,
        information=view_information(model, observations, all_poses[torch.from_numpy(enough)]),
        jacobian=jacobian.reshape(*cells, 2, 2, -1),
        depths=depths,
        glass=patch_coordinates(model, pixels).reshape(*cells, 2),
    )


def _at_depths(derivatives: Array, depths: Array) -> Array:
    """Return the (n D 2, K) derivatives of the undistorted positions of n pixels at D depths from
    the (n, 2, 2, K) derivatives of A and B.
    """
    powers = np.stack([np.ones_like(depths), 1 / depths])
    rows = np.einsum("nabs,ad->ndbs", derivatives, powers)
    return np.asarray(rows.reshape(-1, derivatives.shape[-1]))


@dataclass(frozen=True, slots=True, eq=False)
class PlanningFit:
    """The state of knowledge after some views: a fit of them, or the nominal cover if they are too
    few for a fit.
    """

    model: CameraModel
    poses: Tensor
    """(V, 6) poses of these views."""
    observations: Observations
    smoothness: Smoothness
    sigma: float
    """px per axis"""

    def design(self, setup: Setup, poses: Array, cells: tuple[int, int], depths: Array) -> Design:
        """Return the design of the (P, 6) poses; `cells` and `depths` are those of `survey`."""
        bank = survey(self.model, setup.board, setup.camera, poses, cells, depths)
        observations = self.observations
        visible = observations.select_rows(
            reach_board(self.model.path, self.model.means, observations, self.poses)
        )
        existing = (
            view_information(self.model, visible, self.poses)
            if len(self.poses)
            else bank.information[:0]
        )
        return bank.design(self.smoothness, self.sigma, existing)


def estimate(setup: Setup, views: Sequence[View], grid: tuple[int, int]) -> PlanningFit:
    """Return the best estimate after some views, perhaps none; `grid` is the relief's grid of
    centres.

    Raises:
        NotEnoughDataError: the corners cannot be seen through the cover.
    """
    observations = Observations.of(views, setup.board)
    # A few views do not tell whether the glass is even; more must be able to.
    setup = replace(setup, cover=setup.cover.with_surface(UNEVEN))
    if len(views) >= MIN_FITTED_VIEWS:
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
    region = footprint(path, values, setup.camera.width, setup.camera.height)
    relief = relief_over(path, values, region, grid)
    poses = pinhole_poses(path, values, observations)
    if views:
        poses = refine_poses(path, values, observations, poses).blocks
    path = with_relief(path, relief)
    values["relief.amplitudes"] = torch.zeros(grid, dtype=torch.float64)
    model = CameraModel(path, values, priors_of(setup.intrinsics, setup.cover, path))
    return PlanningFit(model, poses, observations, PRIOR_GLASS, FIRST_SIGMA)
