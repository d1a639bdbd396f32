"""The pose of the board in each view: a start from the pinhole model, then a refinement through the
full ray path.
"""

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.levenberg_marquardt import Solution, minimise
from calib.estimation.objective import HUBER, LandingProblem, view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.estimation.residuals import Residuals, reach_board, residuals
from calib.optics.lens_model import COEFFICIENTS
from calib.optics.params import Values
from calib.optics.path import Path
from calib.session.parameter_names import CAMERA

TOLERANCE = 1e-10
"""A pose has converged when a step lowers its squares by less than this fraction."""
MIN_FORWARD = 0.1
"""The smallest z of a unit direction that counts for the start of a pose: directions more than 84
degrees from the middle of their view are too flat.
"""


def pinhole_poses(path: Path, values: Values, observations: Observations) -> Tensor:
    """Return each view's pose through the lens of a path as if there were no cover, by
    perspective-n-point and its refinement (step 1 of the paper's real experiment).

    Returns:
        (V, 6) T_camera_board, rotation vector (rad) and translation (m); NaN for a view whose
        corners admit no pose.
    """
    if path.lens.wide:
        return _poses_by_rays(Path(path.lens.with_pupil(())), values, observations)
    camera, coefficients = opencv_intrinsics(values)
    poses = [
        _pnp(corners.numpy(), pixels.numpy(), camera, coefficients)
        for corners, pixels in zip(
            observations.per_view(observations.corners),
            observations.per_view(observations.pixels),
            strict=True,
        )
    ]
    return torch.from_numpy(np.stack(poses)) if poses else torch.zeros(0, 6, dtype=torch.float64)


def opencv_intrinsics(values: Values) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return OpenCV's (3, 3) camera matrix and its (n,) distortion coefficients."""
    fx = float(values[CAMERA.fx])
    fy = float(values[CAMERA.fy])
    cx = float(values[CAMERA.cx])
    cy = float(values[CAMERA.cy])
    names = [CAMERA.of(name) for name in COEFFICIENTS if CAMERA.of(name) in values]
    coefficients = np.array([float(values[name]) for name in names])
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), coefficients


def refine_poses(
    path: Path,
    values: Values,
    observations: Observations,
    poses: Tensor,
    tolerance: float = TOLERANCE,
) -> Solution:
    """Refine each view's pose through the cover, with the paper's objective: squared distances on
    the board (equation 2).

    Args:
        poses: (V, 6) to start from.
        tolerance: the fraction of the squares by which a last step would lower them.

    Returns:
        The solution; its blocks are the (V, 6) poses.
    """
    # A corner whose ray never leaves the cover carries no information about its board.
    failures = [path.trace(b.pixels, values, b.exposure).failure for b in observations.batches()]
    observations = observations.select_rows(torch.cat(failures) == 0)
    eye = torch.eye(2, dtype=poses.dtype, device=poses.device)
    return _refine(
        path,
        values,
        observations,
        poses,
        eye * observations.weight[:, None, None],
        torch.inf,
        tolerance,
    )


def refine_poses_in_image(
    path: Path,
    values: Values,
    observations: Observations,
    poses: Tensor,
    *,
    sigma: float = 1.0,
    tolerance: float = TOLERANCE,
) -> Solution:
    """Refine each view's pose to the least reprojection error, robust against single bad corners
    beyond three times sigma (px); otherwise like `refine_poses`.
    """
    observations = observations.select_rows(reach_board(path, values, observations, poses))
    return _refine(
        path,
        values,
        observations,
        poses,
        pixel_weights(path, values, observations, poses, sigma),
        HUBER,
        tolerance,
    )


def refit_poses(
    path: Path, values: Values, observations: Observations, start: Tensor, *, sigma: float = 1.0
) -> tuple[Tensor, Residuals]:
    """Fit the (V, 6) poses of least reprojection error through a known path, and return them with
    their residuals. sigma (px) is that of `refine_poses_in_image`; it also weights the corners
    against the prior of further view parameters.
    """
    poses = refine_poses(path, values, observations, start).blocks
    poses = refine_poses_in_image(path, values, observations, poses, sigma=sigma).blocks
    return poses, residuals(path, values, observations, poses)


def _refine(
    path: Path,
    values: Values,
    observations: Observations,
    poses: Tensor,
    weights: Tensor,
    huber: float,
    tolerance: float,
) -> Solution:
    parameters = Parameters.none(values)
    blocks = tuple(make_residual_blocks(path, parameters, observations, weights))
    problem = LandingProblem(
        parameters, blocks, poses.new_zeros(0, 0), view_precision(path, poses), huber
    )
    return minimise(problem, poses.new_zeros(0), poses, tolerance=tolerance)


def _poses_by_rays(path: Path, values: Values, observations: Observations) -> Tensor:
    """Return each view's pose through a lens that cv2.solvePnP does not support."""
    poses = rough_poses(path, values, observations)
    failed = ~torch.isfinite(poses).all(-1)
    if not bool(failed.all()):
        poses[~failed] = refine_poses_in_image(
            path, values, observations.without_views(failed), poses[~failed]
        ).blocks
    return poses


def rough_poses(path: Path, values: Values, observations: Observations) -> Tensor:
    """Return each view's (6,) pose through any lens: its rays are rotated so that a pinhole could
    image them. It is NaN for a view that has no pose.
    """
    rays = path.trace(observations.pixels, values, observations.exposure)
    directions = torch.where((rays.failure == 0).unsqueeze(-1), rays.direction.stacked(), torch.nan)
    poses = [
        _pnp_by_rays(corners.numpy(), view_directions.numpy())
        for corners, view_directions in zip(
            observations.per_view(observations.corners),
            observations.per_view(directions),
            strict=True,
        )
    ]
    return torch.from_numpy(np.stack(poses)) if poses else torch.zeros(0, 6, dtype=torch.float64)


def _pnp_by_rays(
    corners: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the (6,) T_camera_board of (n, 2 or 3) m corners on the board seen in (n, 3) unit
    directions, NaN where there is no ray; NaN if there is no pose.
    """
    valid = np.isfinite(directions).all(-1)
    middle = directions[valid].sum(0)
    length = np.linalg.norm(middle)
    if not length > 0:
        return np.full(6, np.nan)
    turn = _rotation_to_axis(middle / length)
    turned = directions @ turn.T
    valid &= turned[:, 2] > MIN_FORWARD
    pose = _pnp(corners[valid], turned[valid, :2] / turned[valid, 2:], np.eye(3), np.zeros(0))
    if np.isfinite(pose).all():
        pose[:3] = cv2.Rodrigues(turn.T @ cv2.Rodrigues(pose[:3])[0])[0].ravel()
        pose[3:] = turn.T @ pose[3:]
    return pose


def _rotation_to_axis(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (3, 3) rotation by the smallest angle that turns a (3,) unit direction onto the z
    axis.
    """
    axis = np.cross(direction, [0, 0, 1.0])
    sine = float(np.linalg.norm(axis))
    angle = np.arctan2(sine, direction[2])
    return np.asarray(
        cv2.Rodrigues(axis * (angle / sine) if sine > 0 else np.array([angle, 0, 0]))[0], np.float64
    )


def _pnp(
    corners: NDArray[np.float64],
    pixels: NDArray[np.float64],
    camera: NDArray[np.float64],
    coefficients: NDArray[np.float64],
) -> NDArray[np.float64]:
    if len(corners) < 4:
        return np.full(6, np.nan)
    is_flat = corners.shape[1] == 2
    points = np.pad(corners, ((0, 0), (0, 3 - corners.shape[1])))
    method = cv2.SOLVEPNP_IPPE if is_flat else cv2.SOLVEPNP_SQPNP
    try:
        success, rotvec, translation = cv2.solvePnP(
            points, pixels, camera, coefficients, flags=method
        )
        if not success:
            return np.full(6, np.nan)
        rotvec, translation = cv2.solvePnPRefineLM(
            points, pixels, camera, coefficients, rotvec, translation
        )
    except cv2.error:  # corners on one line, or nowhere near a plane
        return np.full(6, np.nan)
    pose = np.concatenate([np.ravel(rotvec), np.ravel(translation)]).astype(np.float64)
    depth = pose[5] if is_flat else (cv2.Rodrigues(pose[:3])[0] @ points.mean(0) + pose[3:])[2]
    return pose if np.isfinite(pose).all() and depth > 0 else np.full(6, np.nan)
