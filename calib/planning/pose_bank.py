"""The bank of poses in which a person can hold the board before this camera: some hundred, over the
picture, depths and tilts.

A board with markers may extend beyond the picture's border, where a cover bends light most. This
module knows no cover. A cover shifts the picture of the board by some pixels, for which the margin
of the picture leaves room.
"""

from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.pose_requirements import MIN_POSE_CORNERS
from calib.errors import InputError
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.lens import OPENCV

Array = NDArray[np.float64]

MARGIN = 0.01
"""The margin at each border, as a fraction of the picture's width."""
QUIET_SQUARES = 0.5
"""Squares around the outermost corners that must be in the picture."""
TILT = np.radians(32)
"""rad, about each axis: at 45 degrees about both axes, corners are hard to find."""
LEVELS = 3
"""The number of depths, evenly spaced in inverse depth, in which refraction is linear."""
MAX_FILL = 0.75
MIN_FILL = 0.25
"""The board's longer side over the picture's shorter one, nearest and farthest, if no reach is
stated.
"""
MIN_INSIDE = 0.3
"""The part of half a board with markers between the picture's border and the board's middle: two
thirds of the board are visible at a side.
"""
MIN_VISIBLE = 0.4
"""The fraction of the board's corners that is visible in a corner of the picture."""
PATH_POINTS = 20
"""Points between the picture's middle and a corner of the board. A polynomial that turns back
between them no longer describes the lens.
"""
MAX_TANGENT = 4.0
"""x / z: 76 degrees from the axis; a board farther out is too oblique to be useful."""
NEAR_AXIS = 0.1
"""rad"""
DEFAULT_FOCAL = 0.8
"""The focal length over the picture's longer side if the intrinsics are unknown: 64 degrees
wide.
"""


@dataclass(frozen=True, slots=True)
class Reach:
    """The range of depths at which the board is held."""

    near: float
    """m"""
    far: float
    """m"""

    def levels(self, count: int = LEVELS) -> Array:
        """Return (count,) m depths from near to far, evenly spaced in inverse depth."""
        return np.asarray(1 / np.linspace(1 / self.near, 1 / self.far, count), np.float64)

    @staticmethod
    def of(board: Board, camera: Camera) -> "Reach":
        """Return the range for a board of this size: from where it fills three quarters of the
        picture's shorter side to where it fills one quarter.
        """
        side = 2 * max(board.half)
        # m, where the board fills the shorter side completely.
        full = camera_matrix(camera)[0, 0] * side / min(camera.width, camera.height)
        return Reach(full / MAX_FILL, full / MIN_FILL)


@dataclass(frozen=True, slots=True, eq=False)
class PoseBank:
    """P poses, and the board's corners as the bare camera would see them in each."""

    poses: Array
    """(P, 6) T_camera_board: rotation vector (rad) and translation (m)."""
    corners: Array
    """(P, count, 2) px, NaN outside the picture."""


def make_pose_bank(board: Board, camera: Camera, reach: Reach) -> PoseBank:
    """Return every pose of a lattice in which the complete board is in the picture. For a board
    with markers, add poses around it in which the board extends beyond the border. Farther boards
    cover less of the picture, so they get more places.

    Raises:
        InputError: there is no such pose.
    """
    low, high = _borders(camera)
    half = np.array(board.half) + QUIET_SQUARES * board.square
    rim = np.array([[x, y, 0] for x, y in product((-1, 1), repeat=2)]) * [*half, 0]
    poses = []
    for level, depth in enumerate(reach.levels()):
        for tilt in product((-TILT, 0, TILT), repeat=2):
            turn = np.array([*tilt, 0.0])
            turned = rim @ cv2.Rodrigues(turn)[0].T
            rim_depth = depth + turned[:, 2:]  # (4, 1) m
            # m: the range of the board's middle.
            lower = (low * rim_depth - turned[:, :2]).max(0)
            upper = (high * rim_depth - turned[:, :2]).min(0)
            if (lower < upper).all():
                places = _places(lower, upper, level)
                poses += [np.array([*turn, *place, depth]) for place in places]
            if board.coding:
                margin = MIN_INSIDE * np.array(board.half)
                places = _places(low * depth + margin, high * depth - margin, level, outermost=True)
                poses += [np.array([*turn, *place, depth]) for place in places]
    if not poses:
        raise InputError(
            f"A board of {board} corners and {board.square * 1000:g} mm does not fit into the"
            f" picture anywhere between {reach.near:g} and {reach.far:g} m: hold it farther away,"
            " or correct its numbers."
        )
    corners = np.array([project_bare(board, camera, pose) for pose in poses])
    enough = has_enough_corners(corners, board)
    return PoseBank(np.array(poses)[enough], corners[enough])


def _places(lower: Array, upper: Array, level: int, *, outermost: bool = False) -> list[Array]:
    """Return the (2,) m places of the board's middle: a lattice between two limits, or only its
    outermost places.
    """
    xs = np.linspace(lower[0], upper[0], 3 + level)
    ys = np.linspace(lower[1], upper[1], 3 + level // 2)
    return [
        np.array([x, y])
        for i, x in enumerate(xs)
        for j, y in enumerate(ys)
        if not outermost or i in (0, len(xs) - 1) or j in (0, len(ys) - 1)
    ]


def has_enough_corners(corners: Array, board: Board) -> NDArray[np.bool_]:
    """Return (P,), true for poses with enough visible corners, from (P, count, 2) px that are NaN
    where a corner is not visible.
    """
    needed = (
        board.count if not board.coding else max(MIN_VISIBLE * board.count, 2 * MIN_POSE_CORNERS)
    )
    return np.asarray(np.isfinite(corners[..., 0]).sum(1) >= min(needed, board.count))


def mask_to_picture(corners: Array, camera: Camera) -> Array:
    """Return (..., 2) px, NaN outside the picture."""
    limit = [camera.width - 1, camera.height - 1]
    valid = ((corners > 0) & (corners < limit)).all(-1, keepdims=True)  # false for NaN
    return np.where(valid, corners, np.nan)


def camera_matrix(camera: Camera) -> Array:
    """Return OpenCV's (3, 3) camera matrix; that of a usual lens if the intrinsics are unknown."""
    k = camera.intrinsics
    if k:
        return np.array([[k.fx.value, 0, k.cx.value], [0, k.fy.value, k.cy.value], [0, 0, 1]])
    focal = DEFAULT_FOCAL * max(camera.width, camera.height)
    return np.array(
        [[focal, 0, (camera.width - 1) / 2], [0, focal, (camera.height - 1) / 2], [0, 0, 1]]
    )


def project_bare(board: Board, camera: Camera, pose: Array) -> Array:
    """Return the (count, 2) px where the bare camera sees the corners of a board at the (6,) pose;
    for a board with markers, NaN outside the picture.
    """
    pixels = _project(_points_3d(board), pose, camera)
    if not board.coding:
        return pixels
    points = _points_3d(board) @ cv2.Rodrigues(pose[:3])[0].T + pose[3:]
    plane = np.column_stack([points[:, :2] / points[:, 2:], np.zeros(len(points))])
    # From the middle outwards.
    line = np.linspace(0, 1, PATH_POINTS)[:, None, None] * plane
    identity = np.array([0, 0, 0, 0, 0, 1.0])
    image = _project(line.reshape(-1, 3), identity, camera).reshape(PATH_POINTS, -1, 2)
    folded = (np.diff(np.linalg.norm(image - image[0], axis=-1), axis=0) < 0).any(0)
    return mask_to_picture(np.where(folded[:, None], np.nan, pixels), camera)


def fit_bare_pose(board: Board, camera: Camera, corners: Array) -> Array | None:
    """Return the (6,) pose of a board whose corners the bare camera sees at (count, 2) px, NaN
    where not detected; None if there is no such pose.
    """
    detected = np.isfinite(corners[:, 0])
    if _is_fisheye(camera):
        matrix, lens = np.eye(3), np.zeros(0)
        pixels = _normalise(corners[detected], camera)
    else:
        matrix, lens = camera_matrix(camera), _lens(camera)
        pixels = corners[detected]
    success, turn, shift = cv2.solvePnP(
        _points_3d(board)[detected], pixels, matrix, lens, flags=cv2.SOLVEPNP_IPPE
    )
    pose = np.concatenate([np.ravel(turn), np.ravel(shift)]) if success else np.full(6, np.nan)
    return pose if np.isfinite(pose).all() and pose[5] > 0 else None


def outline_corners(board: Board) -> NDArray[np.intp]:
    """Return the (N,) indices of the corners on the board's outline, in order around it."""
    index = np.arange(board.count).reshape(board.rows, board.columns)
    return np.concatenate([index[0], index[1:, -1], index[-1, -2::-1], index[-2:0:-1, 0]])


def outline(corners: Array, board: Board) -> Array:
    """Return the (N, 2) px of the board's outermost corners, in order around it, from (count, 2)
    px; corners that are not detected are predicted by the homography of the others.
    """
    indices = outline_corners(board)
    detected = np.isfinite(corners[:, 0])
    if detected[indices].all():
        return corners[indices]
    homography = cv2.findHomography(board.points()[detected], corners[detected])[0]
    predicted = cv2.perspectiveTransform(board.points()[indices].reshape(-1, 1, 2), homography)
    return np.where(detected[indices, None], corners[indices], predicted.reshape(-1, 2))


def _borders(camera: Camera) -> tuple[Array, Array]:
    """Return the (2,) least and the (2,) greatest x / z and y / z such that the rectangle between
    them is in the picture.
    """
    margin = MARGIN * camera.width
    xs = np.linspace(margin, camera.width - 1 - margin, 9)
    ys = np.linspace(margin, camera.height - 1 - margin, 9)
    x_min = _normalise(np.column_stack([np.full(9, xs[0]), ys]), camera)[:, 0].max()
    x_max = _normalise(np.column_stack([np.full(9, xs[-1]), ys]), camera)[:, 0].min()
    y_min = _normalise(np.column_stack([xs, np.full(9, ys[0])]), camera)[:, 1].max()
    y_max = _normalise(np.column_stack([xs, np.full(9, ys[-1])]), camera)[:, 1].min()
    return np.array([x_min, y_min]), np.array([x_max, y_max])


def _points_3d(board: Board) -> Array:
    """Return the (count, 3) m corners in the board's frame."""
    return board.points_in_space()


def _project(points: Array, pose: Array, camera: Camera) -> Array:
    """Return the (N, 2) px where the bare camera images (N, 3) m points of a board at the (6,)
    pose.
    """
    matrix, lens = camera_matrix(camera), _lens(camera)
    if _is_fisheye(camera):
        pixels = cv2.fisheye.projectPoints(points[:, None], pose[:3], pose[3:], matrix, lens)[0]
    else:
        pixels = cv2.projectPoints(points, pose[:3], pose[3:], matrix, lens)[0]
    return np.asarray(pixels, np.float64).reshape(-1, 2)


def _normalise(pixels: Array, camera: Camera) -> Array:
    """Return the (N, 2) x / z and y / z of (N, 2) px. A fisheye's direction farther out than
    MAX_TANGENT is moved there.
    """
    matrix, lens = camera_matrix(camera), _lens(camera)
    if not _is_fisheye(camera):
        return np.asarray(cv2.undistortPoints(pixels, matrix, lens), np.float64).reshape(-1, 2)
    tangents = cv2.fisheye.undistortPoints(pixels[:, None], matrix, lens).reshape(-1, 2)
    outward = (pixels - matrix[:2, 2]) / matrix[[0, 1], [0, 1]]
    length = np.maximum(np.linalg.norm(outward, axis=-1, keepdims=True), 1e-12)
    tangent = np.linalg.norm(tangents, axis=-1, keepdims=True)
    # Beyond 90 degrees the sign of OpenCV's tangent changes.
    flat = ~((tangents * outward).sum(-1, keepdims=True) > 0) | ~(tangent < MAX_TANGENT)
    return np.asarray(
        np.where(flat & (length > NEAR_AXIS), outward / length * MAX_TANGENT, tangents), np.float64
    )


def _is_fisheye(camera: Camera) -> bool:
    return bool(camera.intrinsics and camera.intrinsics.model != OPENCV)


def _lens(camera: Camera) -> Array:
    return np.array(
        [number.value for number in camera.intrinsics.distortion] if camera.intrinsics else [],
        np.float64,
    )
