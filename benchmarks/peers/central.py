"""Held-out error of a central model, one whose rays meet in a point."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from benchmarks.peers.case import CORNERS, Shots

Floats = NDArray[np.float64]
Project = Callable[[Floats], Floats]
"""(N, 3) m in the camera frame to (N, 2) px."""


def scorer(project: Project, corners: Floats = CORNERS) -> Callable[[Shots], float]:
    """px RMS with each view's pose refitted for the least reprojection error.

    Args:
        corners: (81, 3) m, the board as the model has it.
    """
    return partial(_left, project, corners)


def _left(project: Project, corners: Floats, shots: Shots) -> float:
    squared = 0.0
    for pixels, board_points, pose in zip(shots.pixels, shots.seen, shots.poses, strict=True):
        solution = least_squares(
            _miss,
            pose,
            method="lm",
            xtol=1e-12,
            ftol=1e-12,
            args=(project, corners[board_points], pixels[board_points]),
        )
        squared += 2 * solution.cost
    return float(np.sqrt(squared / shots.seen.sum()))


def _miss(pose: Floats, project: Project, corners: Floats, pixels: Floats) -> Floats:
    return (project(Rotation.from_rotvec(pose[:3]).apply(corners) + pose[3:]) - pixels).ravel()
