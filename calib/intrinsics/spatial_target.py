"""The start of intrinsics from a target whose points are on no plane.

cv2.calibrateCamera finds a focal length by itself only from flat boards. Here several focal lengths
are tried, with the pose that fits each best.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.pose_requirements import MIN_POSE_CORNERS
from calib.corners.view import View
from calib.errors import InputError
from calib.session.board import Board

FOCALS = tuple(0.2 * 1.3**step for step in range(16))
"""Focal lengths over the picture's longer side that are tried, from 0.2 to 10."""
MIN_DEPTH = 0.05
"""The extent of points along their shortest axis over that along the longest one, from which they
are on no plane.
"""
MAX_TRIED_VIEWS = 6
"""The most views that are tried."""
MIRRORED = 1 / 3
"""The error of the mirrored target over that of the target, below which its axes are left-handed.
"""
MIN_FOLD_VIEWS = 4
"""The fewest views from which a lens is chosen by views that are held out."""

Array = NDArray[np.float64]


def plane_normal(points: Array) -> Array | None:
    """Return the (3,) unit normal of the plane of (n, 2 or 3) m points, either way; None if they
    are on no plane.
    """
    if points.shape[1] == 2:
        return np.array([0, 0, 1.0])
    offset = points - points.mean(0)
    squares, axes = np.linalg.eigh(offset.T @ offset)
    return None if squares[0] > MIN_DEPTH**2 * squares[2] else np.asarray(axes[:, 0])


def has_depth(view: View, board: Board) -> bool:
    """True if the points of a view are on no plane, so that it shows the focal length by itself."""
    return plane_normal(board.points()[view.seen]) is None


def spread_deg(poses: Array, views: Sequence[View], board: Board) -> float:
    """Return the degrees between the two most different normals of the planes of the views' points,
    with targets at (V, 6) poses; 180 if the points of a view are on no plane.
    """
    normals = []
    for pose, view in zip(poses, views, strict=True):
        points = board.points()[view.seen]
        normal = plane_normal(points)
        if normal is None:
            return 180.0
        turn = cv2.Rodrigues(pose[:3])[0]
        if not board.is_flat:  # the normal of a flat board has a direction, that of points has none
            normal = normal * np.sign((turn @ points.mean(0) + pose[3:]) @ turn @ normal)
        normals.append(turn @ normal)
    cosines = np.array(normals) @ np.array(normals).T
    return float(np.degrees(np.arccos(np.clip(cosines.min(), -1, 1))))


def find_focal(points: Array, views: Sequence[View], size: tuple[int, int]) -> tuple[float, float]:
    """Return the focal length in px of a pinhole that shows a target best, and its root mean square
    error in px, which is infinite without a pose.

    Args:
        points: (count, 3) m, the points of the target.
        views: its views.
        size: width and height of the picture, px.
    """
    sample = views[:: -(-len(views) // MAX_TRIED_VIEWS)]
    focals = [ratio * max(size) for ratio in FOCALS]
    errors = {focal: _pinhole_error(points, sample, size, focal) for focal in focals}
    best = min(errors, key=errors.__getitem__)
    return best, errors[best]


def check_handedness(views: Sequence[View], board: Board, size: tuple[int, int]) -> None:
    """Raise InputError if the mirror image of a target that is not flat fits the views much better
    than the target.
    """
    if board.is_flat or not views:
        return
    error = find_focal(board.points(), views, size)[1]
    mirrored = find_focal(board.points() * [1.0, 1.0, -1.0], views, size)[1]
    if np.isfinite(error) and mirrored < MIRRORED * error:
        raise InputError(
            f"The target's mirror image fits the pixels to {mirrored:.2g} px, the target itself to"
            f" {error:.2g} px: its x, y and z are a left-handed system. Change the sign of z in the"
            " points of all views."
        )


def split_views(views: Sequence[View]) -> tuple[View, ...]:
    """Return the views; if they are fewer than MIN_FOLD_VIEWS and have the points for it, parts of
    them with every second, third or fourth point, so that some can be held out.
    """
    parts = -(-MIN_FOLD_VIEWS // len(views))
    if parts == 1 or min(view.count for view in views) < 2 * parts * MIN_POSE_CORNERS:
        return tuple(views)
    return tuple(_part(view, first, parts) for view in views for first in range(parts))


def _part(view: View, first: int, step: int) -> View:
    """Return the view with every step-th of its points."""
    rows = np.flatnonzero(view.seen)[first::step]
    is_in = np.isin(np.arange(len(view.weight)), rows)
    corners = np.where(is_in[:, None], view.corners, np.nan)
    return replace(view, corners=corners, weight=np.where(is_in, view.weight, 0.0))


def _pinhole_error(
    points: Array, views: Sequence[View], size: tuple[int, int], focal: float
) -> float:
    """Return the root mean square error in px of a pinhole, with the best poses."""
    middle_x, middle_y = (size[0] - 1) / 2, (size[1] - 1) / 2
    camera = np.array([[focal, 0, middle_x], [0, focal, middle_y], [0, 0, 1.0]])
    squares = []
    for view in views:
        places = points[view.seen]
        pixels = view.corners[view.seen]
        try:
            has_pose, rotvec, shift = cv2.solvePnP(
                places, pixels, camera, None, flags=cv2.SOLVEPNP_SQPNP
            )
        except cv2.error:  # the points determine no pose
            has_pose = False
        if not has_pose:
            return np.inf
        projected = cv2.projectPoints(places, rotvec, shift, camera, None)[0].reshape(-1, 2)
        squares.append(((projected - pixels) ** 2).sum(-1))
    return float(np.sqrt(np.concatenate(squares).mean()))
