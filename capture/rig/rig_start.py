"""The start of a rig's guide: lenses and mountings from the views that the rig has so far."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import permutations

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.planning.pose_bank import fit_bare_pose
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.lens import OPENCV
from calib.session.schema import Number
from capture.rig.moment_gate import Corners
from capture.rig.rig_information import DISTORTION, compose_poses, invert_pose

Array = NDArray[np.float64]

MAX_COEFFICIENTS = 5
"""The number of OpenCV's coefficients that the guide knows."""
MIN_LENS_VIEWS = 3
"""From this number of views on, an unknown focal length is estimated from them."""
ESTIMATED_SIGMA = 0.02
"""The standard deviation of an estimated focal length, as a fraction of it, and of the principal
point, as a fraction of the picture's width.
"""


def estimate_lens(board: Board, camera: Camera, views: Sequence[Array]) -> Camera:
    """Return the camera, with a focal length from its (count, 2) px views if its session has no
    intrinsics: the principal point in the middle, no distortion. Other lenses than
    OpenCV's with five coefficients, which the guide does not use, are left out in the same way.
    """
    k = camera.intrinsics
    if k and k.model == OPENCV and len(k.distortion) <= MAX_COEFFICIENTS and not k.is_unknown:
        return camera
    camera = replace(camera, intrinsics=None)
    if len(views) < MIN_LENS_VIEWS:
        return camera
    points = board.points_in_space().astype(np.float32)
    visible = [np.isfinite(view[:, 0]) for view in views]
    flags = (
        cv2.CALIB_FIX_PRINCIPAL_POINT
        | cv2.CALIB_FIX_ASPECT_RATIO
        | cv2.CALIB_ZERO_TANGENT_DIST
        | cv2.CALIB_FIX_K2
        | cv2.CALIB_FIX_K3
    )
    start = 0.8 * max(camera.width, camera.height)
    middle = ((camera.width - 1) / 2, (camera.height - 1) / 2)
    matrix, lens = cv2.calibrateCamera(
        [points[mask] for mask in visible],
        [view[mask].astype(np.float32) for view, mask in zip(views, visible, strict=True)],
        (camera.width, camera.height),
        np.array([[start, 0, middle[0]], [0, start, middle[1]], [0, 0, 1]]),
        np.zeros(5),
        flags=flags | cv2.CALIB_USE_INTRINSIC_GUESS,
    )[1:3]
    focal = float(matrix[0, 0])
    intrinsics = Intrinsics(
        fx=Number(focal, ESTIMATED_SIGMA * focal),
        fy=Number(focal, ESTIMATED_SIGMA * focal),
        cx=Number(middle[0], ESTIMATED_SIGMA * camera.width),
        cy=Number(middle[1], ESTIMATED_SIGMA * camera.width),
        distortion=tuple(Number(float(value), DISTORTION[0]) for value in np.ravel(lens)[:5]),
    )
    return replace(camera, intrinsics=intrinsics)


def estimate_mountings(
    board: Board, cameras: Mapping[str, Camera], views: Sequence[Corners]
) -> dict[str, Array] | None:
    """Return the (6,) T_camera_reference of each camera; None if some camera shares no view with
    the others.

    The board may look the same after a turn. Of the mountings that the shared views give with each
    turn, the one is taken that is nearest to all of them, and of equal ones the one of least
    rotation.
    """
    poses = [
        {name: fit_bare_pose(board, cameras[name], corners) for name, corners in view.items()}
        for view in views
    ]
    names = list(cameras)
    mountings = {names[0]: np.zeros(6)}
    while len(mountings) < len(names):
        candidates: dict[str, list[Array]] = {}
        for placed, name in permutations(names, 2):
            if placed not in mountings or name in mountings:
                continue
            for moment in poses:
                base, pose = moment.get(placed), moment.get(name)
                if base is None or pose is None:
                    continue
                inverse = invert_pose(compose_poses(invert_pose(mountings[placed]), base))
                turned = [
                    compose_poses(compose_poses(pose, turn), inverse) for turn in _turns(board)
                ]
                candidates.setdefault(name, []).append(np.array(turned))
        if not candidates:
            return None
        name = max(candidates, key=lambda camera: len(candidates[camera]))
        mountings[name] = _agreed(np.array(candidates[name]))
    return mountings


def _turns(board: Board) -> list[Array]:
    """Return the (6,) poses of the turns after which the board looks the same."""
    if board.coding:
        return [np.zeros(6)]
    quarters = range(4) if board.columns == board.rows else (0, 2)
    return [np.array([0, 0, quarter * np.pi / 2, 0, 0, 0]) for quarter in quarters]


def _agreed(candidates: Array) -> Array:
    """Return the (6,) mounting on which (V, K, 6) candidates agree most: the median of those that
    are nearest to it.
    """
    flat = candidates.reshape(-1, 6)
    turns = np.array([cv2.Rodrigues(pose[:3])[0] for pose in flat])
    trace = np.einsum("aij,bij->ab", turns, turns)
    angle = np.arccos(np.clip((trace - 1) / 2, -1, 1)).reshape(len(flat), *candidates.shape[:2])
    own_angle = np.arccos(np.clip((np.trace(turns, axis1=1, axis2=2) - 1) / 2, -1, 1))
    # rad: views that disagree count no more than this, and a rotation only decides between equals
    cost = np.minimum(angle.min(2), 0.1).sum(1) + 0.01 * own_angle
    best = int(cost.argmin())
    nearest = candidates[np.arange(len(candidates)), angle[best].argmin(1)]
    agreeing = nearest[angle[best].min(1) < 0.1]
    inverse = invert_pose(flat[best])
    relative = np.array([compose_poses(pose, inverse) for pose in agreeing])
    return compose_poses(np.median(relative, 0), flat[best])
