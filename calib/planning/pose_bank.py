"""The poses in which a person can hold the board before this camera: some hundred, over the
picture, depths and tilts.

A board with markers may reach out of the picture, where a cover bends most. The cover is not seen
here. It shifts the picture of the board by some pixels, for which the picture's margin leaves room.
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

MARGIN = 0.01  # of the picture's width, at each border
AROUND = 0.5  # squares, that must be in the picture around the outermost corners
TILT = np.radians(32)  # about each axis: at 45 degrees about both, corners are hard to find
LEVELS = 3  # depths, evenly spaced in inverse depth, in which refraction is linear
LARGEST, SMALLEST = (
    0.75,
    0.25,
)  # of the picture's shorter side, the board's longer one: the reach, where none is stated
# of half a board with markers, from the picture's border to its middle: two thirds of it are seen
# at a side
INSIDE = 0.3
FEWEST_SEEN = 0.4  # of its corners: in a corner of the picture so many are
# places from the picture's middle to a corner: a lens's polynomial that turns back on the way is
# not the lens any more
WAY = 20
WIDEST = 4.0  # x / z: 76 degrees from the axis; a board there is seen too flat to be of use
NEAR_AXIS = 0.1  # rad
FOCAL = 0.8  # of the picture's longer side, where intrinsics are not known: 64 degrees across


@dataclass(frozen=True, slots=True)
class Reach:
    """Between which depths the board is held."""

    near: float
    """m"""
    far: float
    """m"""

    def levels(self, count: int = LEVELS) -> Array:
        """(count,) m, near to far, evenly spaced in inverse depth."""
        return np.asarray(1 / np.linspace(1 / self.near, 1 / self.far, count), np.float64)

    @staticmethod
    def of(board: Board, camera: Camera) -> "Reach":
        """What a board of this size allows: it fills most of the picture, or a quarter."""
        side = 2 * max(board.half)
        whole = (
            matrix(camera)[0, 0] * side / min(camera.width, camera.height)
        )  # m, where it fills the shorter side
        return Reach(whole / LARGEST, whole / SMALLEST)


@dataclass(frozen=True, slots=True, eq=False)
class Bank:
    """P poses, and what the bare camera would see of the board in each."""

    poses: Array
    """(P, 6) T_camera_board: rotation vector (rad) and translation (m)."""
    corners: Array
    """(P, count, 2) px, NaN outside of the picture."""


def bank(board: Board, camera: Camera, reach: Reach) -> Bank:
    """Every pose of a lattice that leaves the board wholly in the picture, and for one with markers
    others around it, in which it reaches
    out: farther boards, which cover less, at more places.

    Raises:
        InputError: there is none.
    """
    low, high = _borders(camera)
    half = np.array(board.half) + AROUND * board.square
    rim = np.array([[x, y, 0] for x, y in product((-1, 1), repeat=2)]) * [*half, 0]
    poses = []
    for level, depth in enumerate(reach.levels()):
        for tilt in product((-TILT, 0, TILT), repeat=2):
            turn = np.array([*tilt, 0.0])
            turned = rim @ cv2.Rodrigues(turn)[0].T
            away = depth + turned[:, 2:]  # (4, 1) m
            least, most = (
                (low * away - turned[:, :2]).max(0),
                (high * away - turned[:, :2]).min(0),
            )  # m: where its middle may be
            if (least < most).all():
                poses += [np.array([*turn, *place, depth]) for place in _places(least, most, level)]
            if board.coding:
                inside = INSIDE * np.array(board.half)
                poses += [
                    np.array([*turn, *place, depth])
                    for place in _places(
                        low * depth + inside, high * depth - inside, level, rim=True
                    )
                ]
    if not poses:
        raise InputError(
            f"A board of {board} corners and {board.square * 1000:g} mm is nowhere wholly in the"
            f" picture between {reach.near:g} and {reach.far:g} m: hold it farther away, or correct"
            " its numbers."
        )
    corners = np.array([seen_bare(board, camera, pose) for pose in poses])
    enough = enough_seen(corners, board)
    return Bank(np.array(poses)[enough], corners[enough])


def _places(least: Array, most: Array, level: int, *, rim: bool = False) -> list[Array]:
    """(2,) m each, for the board's middle: a lattice between two limits, or its outermost places
    alone.
    """
    across, down = (
        np.linspace(least[0], most[0], 3 + level),
        np.linspace(least[1], most[1], 3 + level // 2),
    )
    outermost = product(range(len(across)), range(len(down)))
    ends = {0, len(across) - 1}, {0, len(down) - 1}
    return [
        np.array([across[i], down[j]])
        for i, j in outermost
        if not rim or i in ends[0] or j in ends[1]
    ]


def enough_seen(corners: Array, board: Board) -> NDArray[np.bool_]:
    """(P,) whether poses in which these (P, count, 2) px are seen, NaN where not, are worth asking
    for.
    """
    needed = (
        board.count if not board.coding else max(FEWEST_SEEN * board.count, 2 * MIN_POSE_CORNERS)
    )
    return np.asarray(np.isfinite(corners[..., 0]).sum(1) >= min(needed, board.count))


def in_picture(corners: Array, camera: Camera) -> Array:
    """(..., 2) px, NaN where that is not in the picture."""
    inside = ((corners > 0) & (corners < [camera.width - 1, camera.height - 1])).all(
        -1, keepdims=True
    )  # false for NaN
    return np.where(inside, corners, np.nan)


def matrix(camera: Camera) -> Array:
    """(3, 3) OpenCV's camera matrix; a usual lens's where the camera's is not known."""
    k = camera.intrinsics
    if k:
        return np.array([[k.fx.value, 0, k.cx.value], [0, k.fy.value, k.cy.value], [0, 0, 1]])
    focal = FOCAL * max(camera.width, camera.height)
    return np.array(
        [[focal, 0, (camera.width - 1) / 2], [0, focal, (camera.height - 1) / 2], [0, 0, 1]]
    )


def seen_bare(board: Board, camera: Camera, pose: Array) -> Array:
    """(count, 2) px, where the bare camera sees the corners of a board at (6,); of one with
    markers, NaN outside of the picture.
    """
    seen = _projected(_solid(board), pose, camera)
    if not board.coding:
        return seen
    place = _solid(board) @ cv2.Rodrigues(pose[:3])[0].T + pose[3:]
    way = np.linspace(0, 1, WAY)[:, None, None] * np.column_stack(
        [place[:, :2] / place[:, 2:], np.zeros(len(place))]
    )  # from the middle out
    there = _projected(way.reshape(-1, 3), np.array([0, 0, 0, 0, 0, 1.0]), camera).reshape(
        WAY, -1, 2
    )
    folded = (np.diff(np.linalg.norm(there - there[0], axis=-1), axis=0) < 0).any(0)
    return in_picture(np.where(folded[:, None], np.nan, seen), camera)


def bare_pose(board: Board, camera: Camera, corners: Array) -> Array | None:
    """(6,) the pose that (count, 2) px, NaN where not seen, would show to the bare camera; None
    where no pose does.
    """
    seen = np.isfinite(corners[:, 0])
    if _is_fisheye(camera):
        flat, lens, pixels = np.eye(3), np.zeros(0), _normalised(corners[seen], camera)
    else:
        flat, lens, pixels = matrix(camera), _lens(camera), corners[seen]
    found, turn, shift = cv2.solvePnP(
        _solid(board)[seen], pixels, flat, lens, flags=cv2.SOLVEPNP_IPPE
    )
    pose = np.concatenate([np.ravel(turn), np.ravel(shift)]) if found else np.full(6, np.nan)
    return pose if np.isfinite(pose).all() and pose[5] > 0 else None


def rim(board: Board) -> NDArray[np.intp]:
    """(N,) which corners lie on the board's outline, in order around it."""
    index = np.arange(board.count).reshape(board.rows, board.columns)
    return np.concatenate([index[0], index[1:, -1], index[-1, -2::-1], index[-2:0:-1, 0]])


def outline(corners: Array, board: Board) -> Array:
    """(N, 2) px, the board's outermost corners in order around it, from (count, 2) px; those that
    are not seen are where a plane through the others has them.
    """
    around = rim(board)
    seen = np.isfinite(corners[:, 0])
    if seen[around].all():
        return corners[around]
    plane = cv2.findHomography(board.points()[seen], corners[seen])[0]
    said = cv2.perspectiveTransform(board.points()[around].reshape(-1, 1, 2), plane).reshape(-1, 2)
    return np.where(seen[around, None], corners[around], said)


def _borders(camera: Camera) -> tuple[Array, Array]:
    """(2,) the least and the greatest x / z and y / z that are in the picture wherever the other
    one is.
    """
    margin = MARGIN * camera.width
    x, y = (np.linspace(margin, length - 1 - margin, 9) for length in (camera.width, camera.height))
    sides = [
        np.column_stack(np.broadcast_arrays(*side))
        for side in ((x[0], y), (x[-1], y), (x, y[0]), (x, y[-1]))
    ]
    left, right, top, bottom = (_normalised(side, camera) for side in sides)
    return np.array([left[:, 0].max(), top[:, 1].max()]), np.array(
        [right[:, 0].min(), bottom[:, 1].min()]
    )


def _solid(board: Board) -> Array:
    return np.column_stack([board.points(), np.zeros(board.count)])


def _projected(points: Array, pose: Array, camera: Camera) -> Array:
    """(N, 2) px where the bare camera images (N, 3) m on a board at (6,)."""
    if _is_fisheye(camera):
        seen = cv2.fisheye.projectPoints(
            points[:, None], pose[:3], pose[3:], matrix(camera), _lens(camera)
        )[0]
    else:
        seen = cv2.projectPoints(points, pose[:3], pose[3:], matrix(camera), _lens(camera))[0]
    return np.asarray(seen, np.float64).reshape(-1, 2)


def _normalised(pixels: Array, camera: Camera) -> Array:
    """(N, 2) px to (N, 2) x / z and y / z; what a fisheye sees flatter than `WIDEST`, as there."""
    if not _is_fisheye(camera):
        return np.asarray(
            cv2.undistortPoints(pixels, matrix(camera), _lens(camera)), np.float64
        ).reshape(-1, 2)
    found = cv2.fisheye.undistortPoints(pixels[:, None], matrix(camera), _lens(camera)).reshape(
        -1, 2
    )
    outward = (pixels - matrix(camera)[:2, 2]) / matrix(camera)[[0, 1], [0, 1]]
    length = np.maximum(np.linalg.norm(outward, axis=-1, keepdims=True), 1e-12)
    tangent = np.linalg.norm(found, axis=-1, keepdims=True)
    flat = ~((found * outward).sum(-1, keepdims=True) > 0) | ~(
        tangent < WIDEST
    )  # beyond 90 degrees OpenCV's tangent turns round
    return np.asarray(
        np.where(flat & (length > NEAR_AXIS), outward / length * WIDEST, found), np.float64
    )


def _is_fisheye(camera: Camera) -> bool:
    return bool(camera.intrinsics and camera.intrinsics.model != OPENCV)


def _lens(camera: Camera) -> Array:
    return np.array(
        [number.value for number in camera.intrinsics.distortion] if camera.intrinsics else [],
        np.float64,
    )
