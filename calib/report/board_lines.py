"""The rows and columns of a board as lens and cover show them, and undistorted."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import chain

import cv2
import numpy as np
import torch

from calib.optics.board_target import Target
from calib.report.evidence import Array, Evidence

SAMPLES = 41
"""Points of a line."""


@dataclass(frozen=True, slots=True)
class BoardLine:
    """A row or column of a board, from its first corner to its last one."""

    distorted: Array
    """(n, 2) px, the line through lens and cover, by the model."""
    undistorted: Array
    """(n, 2) px, the straight line."""
    depth: Array
    """(n,) m, of its points."""
    corners: Array
    """(c, 2) px, the detected corners of the line, without the bend of the board itself."""
    undistorted_corners: Array
    """(c, 2) px, these corners undistorted."""
    bow: Array
    """(c, 2) px: by how much the board's own bend or motion shifts them, which is taken away."""

    @property
    def bend(self) -> float:
        """The largest distance in px between the line and the chord of its ends, as taken."""
        return float(np.abs(distance_to_chord(self.distorted, self.distorted)).max())

    @property
    def rms(self) -> float:
        """The root mean square of the distances in px of the undistorted corners from the line."""
        errors = distance_to_fit(self.undistorted_corners, self.undistorted)
        return float(np.sqrt((errors**2).mean()))


def distance_to_chord(points: Array, line: Array) -> Array:
    """Return the (n,) px by which (n, 2) points lie beside the chord between the ends of a line."""
    chord = line[-1] - line[0]
    normal = np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
    return np.asarray((points - line[0]) @ normal)


def distance_to_fit(points: Array, line: Array) -> Array:
    """Return the (n,) px by which (n, 2) points lie beside the straight line that fits a (k, 2) px
    line best.
    """
    middle = line.mean(0)
    normal = np.linalg.svd(line - middle, full_matrices=False)[2][1]
    return np.asarray((points - middle) @ normal)


def grid_lines(evidence: Evidence, view: int) -> Iterator[BoardLine]:
    """Yield the rows and columns of a view's board that the camera sees from end to end."""
    board = evidence.calibration.board
    pose = evidence.calibration.poses[view, :6]
    rotation = cv2.Rodrigues(pose[:3])[0]
    focal, centre = _pinhole(evidence)
    points = board.points_in_space() @ rotation.T + pose[3:]
    grid = points.reshape(board.rows, board.columns, 3)
    ends = np.concatenate([grid[:, [0, -1]], grid[[0, -1]].swapaxes(0, 1)])
    steps = np.linspace(0, 1, SAMPLES)[:, None]
    lines = ends[:, :1] + steps * (ends[:, 1:] - ends[:, :1])  # (rows + columns, n, 3) m, camera
    in_front = (lines[..., 2] > 0).all(1)
    depths = np.where(in_front[:, None], lines[..., 2], np.inf)
    straight = focal * lines[..., :2] / depths[..., None] + centre
    distorted, visible = evidence.field.distort_pixels(straight.reshape(-1, 2), depths.ravel())
    distorted = distorted.reshape(straight.shape)
    drawn = in_front & visible.reshape(depths.shape).all(1)
    corner_grids = _corner_grids(evidence, view)
    rows, columns = corner_grids.swapaxes(0, 1), corner_grids.transpose(2, 0, 1, 3)
    for index, (corners, undistorted_corners, shift) in enumerate(chain(rows, columns)):
        is_detected = np.isfinite(corners).all(-1)
        if drawn[index] and is_detected.sum() > 1:
            yield BoardLine(
                distorted=distorted[index],
                undistorted=straight[index],
                depth=depths[index],
                corners=corners[is_detected],
                undistorted_corners=undistorted_corners[is_detected],
                bow=shift[is_detected],
            )


def _corner_grids(evidence: Evidence, view: int) -> Array:
    """Return (3, rows, columns, 2) px: a view's detected corners, and the same undistorted, both
    without the shift by the board's bow or motion, and this shift; NaN where a corner was not
    detected.
    """
    board = evidence.calibration.board
    observations = evidence.calibration.observations.view_range(range(view, view + 1))
    in_view = evidence.view == view
    poses = torch.from_numpy(evidence.calibration.poses)[view : view + 1][observations.view]
    exposure = observations.exposure
    actual = evidence.path.place(observations.corners, evidence.values, poses, exposure)
    flat_path = replace(evidence.path, target=Target())
    flat = flat_path.place(observations.corners, {}, poses[:, :6], exposure)
    focal, _ = _pinhole(evidence)
    bow = focal * (actual[:, :2] / actual[:, 2:] - flat[:, :2] / flat[:, 2:]).numpy()
    undistorted = evidence.field.undistort_pixels(evidence.pixels[in_view], evidence.depth[in_view])
    grids = np.full((3, board.count, 2), np.nan)
    detected = evidence.calibration.views[view].seen
    grids[0, detected] = evidence.pixels[in_view] - bow
    grids[1, detected] = undistorted - bow
    grids[2, detected] = bow
    return grids.reshape(3, board.rows, board.columns, 2)


def _pinhole(evidence: Evidence) -> tuple[Array, Array]:
    """Return the focal lengths (2,) px and the principal point (2,) px of undistorted pixels."""
    k = evidence.calibration.camera.intrinsics
    assert k
    return np.array([k.fx.value, k.fy.value]), np.array([k.cx.value, k.cy.value])
