"""Where the board was in each view: a start from the pinhole model, then refined through the whole
ray path.
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
from calib.estimation.residual_blocks import landings, pixel_weights
from calib.estimation.residuals import Residuals, residuals
from calib.optics.build import lens_of
from calib.optics.lens_model import COEFFICIENTS
from calib.optics.params import Values
from calib.optics.path import Path

FLATTEST = 0.1
"""z of a unit direction: what is flatter, 84 degrees from the middle of its view, gives a pose no
start.
"""


def pinhole_poses(observations: Observations, values: Values) -> Tensor:
    """Each view's pose as if there were no cover, by perspective-n-point and its refinement (the
    paper's section 4.2, step 1).

    Returns:
        (V, 6) T_camera_board, rotation vector (rad) and translation (m); NaN for a view whose
        corners admit no pose.
    """
    lens = lens_of(values)
    if lens.wide:
        return _poses_by_rays(Path(lens), values, observations)
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
    """OpenCV's (3, 3) camera matrix and its (n,) distortion coefficients."""
    fx, fy, cx, cy = (float(values[f"camera.{name}"]) for name in ("fx", "fy", "cx", "cy"))
    names = [f"camera.{name}" for name in COEFFICIENTS if f"camera.{name}" in values]
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array(
        [float(values[name]) for name in names]
    )


def refine_poses(path: Path, values: Values, observations: Observations, poses: Tensor) -> Solution:
    """Each view's pose through the cover, with the paper's objective: squared distances on the
    board (section 3, equation 2).

    Args:
        poses: (V, 6) to start from.

    Returns:
        The solution; its blocks are the (V, 6) poses.
    """
    # A corner whose ray never leaves the cover says nothing of its board.
    observations = observations.kept(path.trace(observations.pixels, values).failure == 0)
    eye = torch.eye(2, dtype=poses.dtype, device=poses.device)
    return _refined(
        path, values, observations, poses, eye * observations.weight[:, None, None], torch.inf
    )


def refine_poses_in_image(
    path: Path,
    values: Values,
    observations: Observations,
    poses: Tensor,
    *,
    sigma: float = 1.0,
    tolerance: float = 1e-10,
) -> Solution:
    """Each view's pose of least reprojection error, robust against single bad corners from three
    times sigma (px) on; as `refine_poses` otherwise.
    """
    observations = observations.kept(
        path.land(observations.pixels, values, poses[observations.view])[1] == 0
    )
    return _refined(
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
    """The (V, 6) poses of least reprojection error through a known path, and what they leave; sigma
    (px) as `refine_poses_in_image` has it. What else views have for themselves has a prior, which
    is weighed against the corners by it.
    """
    poses = refine_poses(path, values, observations, start).blocks
    poses = refine_poses_in_image(path, values, observations, poses, sigma=sigma).blocks
    return poses, residuals(path, values, observations, poses)


def _refined(
    path: Path,
    values: Values,
    observations: Observations,
    poses: Tensor,
    weights: Tensor,
    huber: float,
    tolerance: float = 1e-10,
) -> Solution:
    none = Parameters.none(values)
    views = tuple(landings(path, none, observations, weights))
    problem = LandingProblem(none, views, poses.new_zeros(0, 0), view_precision(path, poses), huber)
    return minimise(problem, poses.new_zeros(0), poses, tolerance=tolerance)


def _poses_by_rays(path: Path, values: Values, observations: Observations) -> Tensor:
    """The same by a lens that cv2.solvePnP does not know."""
    poses = rough_poses(path, values, observations)
    lost = ~torch.isfinite(poses).all(-1)
    if not bool(lost.all()):
        poses[~lost] = refine_poses_in_image(
            path, values, observations.without(lost), poses[~lost]
        ).blocks
    return poses


def rough_poses(path: Path, values: Values, observations: Observations) -> Tensor:
    """Each view's (6,) pose by any lens: its rays are turned to where a pinhole could take its
    picture. NaN for a view that has none.
    """
    rays = path.trace(observations.pixels, values)
    directions = torch.where((rays.failure == 0).unsqueeze(-1), rays.direction.stacked(), torch.nan)
    each = zip(
        observations.per_view(observations.corners), observations.per_view(directions), strict=True
    )
    begun = [_pnp_by_rays(corners.numpy(), own.numpy()) for corners, own in each]
    return torch.from_numpy(np.stack(begun)) if begun else torch.zeros(0, 6, dtype=torch.float64)


def _pnp_by_rays(
    corners: NDArray[np.float64], directions: NDArray[np.float64]
) -> NDArray[np.float64]:
    """(6,) T_camera_board of (n, 2) m on the board in (n, 3) unit directions, NaN where there is
    none; NaN if there is no pose.
    """
    seen = np.isfinite(directions).all(-1)
    middle = directions[seen].sum(0)
    length = np.linalg.norm(middle)
    if not length > 0:
        return np.full(6, np.nan)
    turn = _onto_axis(middle / length)
    ahead = directions @ turn.T
    seen &= ahead[:, 2] > FLATTEST
    pose = _pnp(corners[seen], ahead[seen, :2] / ahead[seen, 2:], np.eye(3), np.zeros(0))
    if np.isfinite(pose).all():
        pose[:3] = cv2.Rodrigues(turn.T @ cv2.Rodrigues(pose[:3])[0])[0].ravel()
        pose[3:] = turn.T @ pose[3:]
    return pose


def _onto_axis(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) rotation that turns a (3,) unit direction onto the z axis, the shortest way."""
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
    points = np.column_stack([corners, np.zeros(len(corners))])
    try:
        found, rotvec, translation = cv2.solvePnP(
            points, pixels, camera, coefficients, flags=cv2.SOLVEPNP_IPPE
        )
        if not found:
            return np.full(6, np.nan)
        rotvec, translation = cv2.solvePnPRefineLM(
            points, pixels, camera, coefficients, rotvec, translation
        )
    except cv2.error:  # corners on one line, or nowhere near a plane
        return np.full(6, np.nan)
    pose = np.concatenate([np.ravel(rotvec), np.ravel(translation)]).astype(np.float64)
    return pose if np.isfinite(pose).all() and pose[5] > 0 else np.full(6, np.nan)
