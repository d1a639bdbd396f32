"""The information of a placement of the board about a rig, as `calib rig fit` eliminates it: the
corners of all cameras that see the placement, with its six numbers taken out by the Schur
complement.

The numbers are the lens of each camera and the mountings. The cameras are taken as bare: the glass
of a cover bends rays far more alike from view to view than it tells the mountings apart, and each
camera's own guide asks for views of all of its picture. So this needs no torch, and takes
milliseconds a placement.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import permutations

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.planning.pose_bank import camera_matrix
from calib.session.board import Board
from calib.session.camera import Camera

Array = NDArray[np.float64]

NOISE_PX = 0.2
"""px per axis: twice what measured rigs have in their corners, because what no model holds scatters
from placement to placement.
"""
UNKNOWN_FOCAL = 0.3
"""The standard deviation of an unknown focal length, as a fraction of it."""
STATED_FOCAL = 0.003
"""The same of one that a session states without a sigma."""
UNKNOWN_CENTRE = 0.05
"""The standard deviation of an unknown principal point, as a fraction of the picture's width."""
STATED_CENTRE = 0.003
"""The same of one that a session states without a sigma."""
DISTORTION = (0.3, 0.3, 0.01, 0.01, 0.3)
"""The standard deviations of OpenCV's k1, k2, p1, p2, k3."""
MOUNTING = (1.0, 1.0)
"""rad and m, of a mounting that nobody knows."""
LENS_COUNT = 9
"""The numbers of a lens: fx, fy, cx, cy and OpenCV's five coefficients."""
GRID = (5, 7)
"""Rows and columns of the pixels at which the disparity's error is predicted."""
STEP = 1e-6
"""The step of the numerical derivatives, in units of each number's scale."""


@dataclass(frozen=True, slots=True, eq=False)
class RigModel:
    """The bare cameras of a rig, and how they are mounted. Its vector has the lens of each camera,
    then the mounting of each camera but the reference, which is the first.
    """

    board: Board
    cameras: Mapping[str, Camera]
    mountings: Mapping[str, Array]
    """(6,) T_camera_reference, rotation vector (rad) and translation (m)."""

    @property
    def count(self) -> int:
        """S, the length of the vector."""
        return LENS_COUNT * len(self.cameras) + 6 * (len(self.cameras) - 1)

    def lens(self, name: str) -> Array:
        """Return the (9,) numbers of a camera's lens."""
        camera = self.cameras[name]
        matrix = camera_matrix(camera)
        stated = camera.intrinsics.distortion[:5] if camera.intrinsics else ()
        distortion = np.zeros(5)
        distortion[: len(stated)] = [number.value for number in stated]
        return np.array([matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *distortion])

    def vector(self) -> Array:
        """Return the (S,) vector."""
        names = list(self.cameras)
        return np.concatenate(
            [*(self.lens(name) for name in names), *(self.mountings[name] for name in names[1:])]
        )

    def prior_sigma(self) -> Array:
        """Return the (S,) standard deviations before any view."""
        sigmas: list[float] = []
        for name, camera in self.cameras.items():
            k = camera.intrinsics
            focal = self.lens(name)[0]
            if k:
                sigmas += [max(n.sigma, STATED_FOCAL * focal) for n in (k.fx, k.fy)]
                sigmas += [max(n.sigma, STATED_CENTRE * camera.width) for n in (k.cx, k.cy)]
            else:
                sigmas += 2 * [UNKNOWN_FOCAL * focal] + 2 * [UNKNOWN_CENTRE * camera.width]
            sigmas += DISTORTION
        turn, shift = MOUNTING
        return np.array([*sigmas, *(len(self.cameras) - 1) * (3 * [turn] + 3 * [shift])])

    def project(self, name: str, placement: Array) -> Array:
        """Return the (count, 2) px at which a camera sees the board at a (6,) placement
        T_reference_board; NaN where a corner is outside of the picture or behind the camera.
        """
        points = self.board.points_in_space()
        pose = compose_poses(self.mountings[name], placement)
        depth = (points @ cv2.Rodrigues(pose[:3])[0].T + pose[3:])[:, 2]
        pixels = _project(points, pose, self.lens(name))
        camera = self.cameras[name]
        limit = [camera.width - 1, camera.height - 1]
        valid = ((pixels > 0) & (pixels < limit)).all(-1) & (depth > 0)
        return np.where(valid[:, None], pixels, np.nan)

    def information(self, placement: Array, visible: Mapping[str, NDArray[np.bool_]]) -> Array:
        """Return the (S, S) information of a (6,) placement of which each camera sees the (count,)
        corners that are true.
        """
        points = self.board.points_in_space()
        names = list(self.cameras)
        shared = np.zeros((0, self.count))
        own = np.zeros((0, 6))
        for name, corners in visible.items():
            index = names.index(name)
            pose = compose_poses(self.mountings[name], placement)
            lens = self.lens(name)
            matrix = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
            seen_points = points[corners]
            slopes = cv2.projectPoints(seen_points, pose[:3], pose[3:], matrix, lens[4:])[1]
            by_placement, by_mounting = _composition_derivatives(self.mountings[name], placement)
            rows = np.zeros((len(slopes), self.count))
            rows[:, LENS_COUNT * index : LENS_COUNT * (index + 1)] = slopes[:, 6:15]
            if index:
                start = LENS_COUNT * len(names) + 6 * (index - 1)
                rows[:, start : start + 6] = slopes[:, :6] @ by_mounting
            shared = np.concatenate([shared, rows])
            own = np.concatenate([own, slopes[:, :6] @ by_placement])
        cross = own.T @ shared
        eliminated = cross.T @ np.linalg.solve(own.T @ own, cross)
        return np.asarray((shared.T @ shared - eliminated) / NOISE_PX**2)

    def disparity_derivatives(self, depths: Array) -> Array:
        """Return (N, 2, S) derivatives of where one camera sees the point at which another looks
        along the ray of a pixel, at (D,) m depths: over all pairs of cameras, pixels and depths
        for which the point is in both pictures.
        """
        vector = self.vector()
        pairs = list(self._pairs(depths))
        if not pairs:
            return np.zeros((0, 2, self.count))
        steps = STEP * self.prior_sigma()
        columns = []
        for index, step in enumerate(steps):
            moved = []
            for sign in (1, -1):
                changed = vector.copy()
                changed[index] += sign * step
                moved.append(np.concatenate([self._transfer(changed, *pair) for pair in pairs]))
            columns.append((moved[0] - moved[1]) / (2 * step))
        return np.stack(columns, -1)

    def _pairs(self, depths: Array) -> Iterator[tuple[int, int, Array, Array]]:
        """Yield pairs of cameras with the (N, 2) px of the first and their (N,) m depths."""
        vector = self.vector()
        cameras = list(self.cameras.values())
        for first, second in permutations(range(len(cameras)), 2):
            rows, columns = GRID
            x = (np.arange(columns) + 0.5) / columns * cameras[first].width - 0.5
            y = (np.arange(rows) + 0.5) / rows * cameras[first].height - 0.5
            grid = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
            pixels = np.tile(grid, (len(depths), 1))
            depth = np.repeat(depths, len(grid))
            places = self._transfer(vector, first, second, pixels, depth)
            limit = [cameras[second].width - 1, cameras[second].height - 1]
            inside_both = ((places > 0) & (places < limit)).all(-1)
            if inside_both.any():
                yield first, second, pixels[inside_both], depth[inside_both]

    def _transfer(
        self, vector: Array, first: int, second: int, pixels: Array, depth: Array
    ) -> Array:
        """Return the (N, 2) px at which the second camera sees what the first one sees."""
        lens = vector[LENS_COUNT * first : LENS_COUNT * (first + 1)]
        matrix = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
        tangents = cv2.undistortPoints(pixels, matrix, lens[4:])
        points = np.column_stack([tangents.reshape(-1, 2), np.ones(len(pixels))]) * depth[:, None]
        relative = compose_poses(
            self._mounting(vector, second), invert_pose(self._mounting(vector, first))
        )
        behind = (points @ cv2.Rodrigues(relative[:3])[0].T + relative[3:])[:, 2] <= 0
        pixels = _project(points, relative, vector[LENS_COUNT * second : LENS_COUNT * (second + 1)])
        return np.where(behind[:, None], np.nan, pixels)

    def _mounting(self, vector: Array, index: int) -> Array:
        start = LENS_COUNT * len(self.cameras) + 6 * (index - 1)
        return vector[start : start + 6] if index else np.zeros(6)


def compose_poses(second: Array, first: Array) -> Array:
    """Return the (6,) pose that applies the first pose, then the second."""
    turn, shift = cv2.composeRT(first[:3], first[3:], second[:3], second[3:])[:2]
    return np.concatenate([turn.ravel(), shift.ravel()])


def invert_pose(pose: Array) -> Array:
    """Return the (6,) inverse of a pose."""
    turn = cv2.Rodrigues(pose[:3])[0]
    return np.concatenate([-pose[:3], -turn.T @ pose[3:]])


def _composition_derivatives(second: Array, first: Array) -> tuple[Array, Array]:
    """Return the (6, 6) derivatives of `compose_poses` by the first pose and by the second."""
    result = cv2.composeRT(first[:3], first[3:], second[:3], second[3:])
    by_first = np.block([[result[2], result[3]], [result[6], result[7]]])
    by_second = np.block([[result[4], result[5]], [result[8], result[9]]])
    return by_first, by_second


def _project(points: Array, pose: Array, lens: Array) -> Array:
    matrix = np.array([[lens[0], 0, lens[2]], [0, lens[1], lens[3]], [0, 0, 1]])
    pixels = cv2.projectPoints(points, pose[:3], pose[3:], matrix, lens[4:])[0]
    return np.asarray(pixels, np.float64).reshape(-1, 2)


def disparity_sigma(derivatives: Array, precision: Array) -> float:
    """Return the root mean variance of the predicted places, px, x and y together; NaN without
    an overlap.
    """
    if not len(derivatives):
        return float("nan")
    root = np.linalg.inv(np.linalg.cholesky(precision))
    return float(np.sqrt(((derivatives @ root.T) ** 2).sum((-2, -1)).mean()))


def choose_placement(
    derivatives: Array, precision: Array, information: Array, candidates: Sequence[int]
) -> int:
    """Return the candidate whose (S, S) information lowers the mean variance most."""
    weight = np.einsum("nbr,nbs->rs", derivatives, derivatives) / max(len(derivatives), 1)
    covariances = np.linalg.inv(precision + information[list(candidates)])
    return candidates[int(np.einsum("prs,sr->p", covariances, weight).argmin())]
