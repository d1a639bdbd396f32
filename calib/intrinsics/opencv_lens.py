"""OpenCV's lens, by Zhang's method (cv2.calibrateCamera).

Source: Z. Zhang, A flexible new technique for camera calibration (2000), the paper's reference for
    its own intrinsics.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from calib.corners.view import View
from calib.errors import NotEnoughDataError
from calib.intrinsics.advice import NO_FIT
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.lens import COEFFICIENTS
from calib.session.schema import Number

CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-9)

FLAGS = {
    0: cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
    4: cv2.CALIB_FIX_K3,
    5: 0,
    8: cv2.CALIB_RATIONAL_MODEL,
    12: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL,
    14: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL | cv2.CALIB_TILTED_MODEL,
}


@dataclass(frozen=True, slots=True)
class OpenCVFit:
    """A lens that was fitted."""

    camera: NDArray[np.float64]
    """(3, 3) px"""
    coefficients: NDArray[np.float64]
    """(count,)"""
    per_view: NDArray[np.float64]
    """(V,) px"""
    poses: NDArray[np.float64]
    """(V, 6) rotation vector and translation of the board."""
    rms: float
    """px"""

    @property
    def focal(self) -> float:
        """px, along x."""
        return float(self.camera[0, 0])

    @property
    def parameters(self) -> NDArray[np.float64]:
        """(4 + count,) fx, fy, cx, cy and the coefficients."""
        return np.array([*self.camera[[0, 1, 0, 1], [0, 1, 2, 2]], *self.coefficients])

    def intrinsics(self, covariance: NDArray[np.float64]) -> Intrinsics:
        """With each number's standard deviation, and how they are correlated, from the covariance
        of `parameters`.
        """
        sigmas = np.sqrt(covariance.diagonal())
        correlation = covariance / np.outer(sigmas, sigmas)
        fx, fy, cx, cy, *lens = (
            Number(float(v), float(s)) for v, s in zip(self.parameters, sigmas, strict=True)
        )
        return Intrinsics(
            fx,
            fy,
            cx,
            cy,
            tuple(lens),
            tuple(tuple(row[:i].tolist()) for i, row in enumerate(correlation) if i),
        )

    def errors(self, views: Sequence[View], board: Board) -> NDArray[np.float64]:
        """(V,) px, the root mean square of views that it was not fitted to, their poses fitted; NaN
        for one that has none.
        """
        return np.array([self._error(view, board) for view in views])

    def _error(self, view: View, board: Board) -> float:
        points = np.column_stack([board.points(), np.zeros(board.count)])[view.seen]
        pixels = view.corners[view.seen]
        try:
            found, rotvec, translation = cv2.solvePnP(
                points, pixels, self.camera, self.coefficients
            )
        except cv2.error:  # corners from which no pose follows
            found = False
        if not found:
            return float("nan")
        seen, _ = cv2.projectPoints(points, rotvec, translation, self.camera, self.coefficients)
        return float(np.sqrt(((seen.reshape(-1, 2) - pixels) ** 2).sum(-1).mean()))


def fit_opencv(
    views: Sequence[View],
    board: Board,
    size: tuple[int, int],
    count: int,
    focal: float | None = None,
) -> OpenCVFit:
    """Zhang's method, from few coefficients to many: started with many at once, it stops in poor
    places.
    """
    solved = None
    for fewer in COEFFICIENTS:
        if fewer < count:
            solved = step(views, board, size, fewer, solved, focal)
    return step(views, board, size, count, solved, focal)


def step(
    views: Sequence[View],
    board: Board,
    size: tuple[int, int],
    count: int,
    start: OpenCVFit | None,
    focal: float | None = None,
) -> OpenCVFit:
    """The fit from a start, its focal length held if one is given (px)."""
    points = np.column_stack([board.points(), np.zeros(board.count)]).astype(np.float32)
    objects = [points[view.seen] for view in views]
    pixels = [view.corners[view.seen].astype(np.float32) for view in views]
    coefficients = np.zeros(max(5, count))
    if start:
        coefficients[: len(start.coefficients)] = start.coefficients
    width, height = size
    camera = (
        start.camera.copy()
        if start
        else np.array([[width, 0, (width - 1) / 2], [0, width, (height - 1) / 2], [0, 0, 1.0]])
    )
    camera[:2, 2] = np.clip(camera[:2, 2], 1, np.array(size) - 2)  # OpenCV starts from nowhere else
    guess = cv2.CALIB_USE_INTRINSIC_GUESS if start or focal else 0
    if focal:
        camera[:2, :2] *= focal / camera[0, 0]
        guess |= cv2.CALIB_FIX_FOCAL_LENGTH
    try:
        with _on_one_thread():
            rms, found, bent, rotvecs, translations, _, _, per_view = cv2.calibrateCameraExtended(
                objects,
                pixels,
                size,
                camera,
                coefficients,
                flags=FLAGS[count] | guess,
                criteria=CRITERIA,
            )
    except cv2.error as error:
        raise NotEnoughDataError(NO_FIT) from error
    lens = np.ravel(bent)[:count].astype(np.float64)
    return OpenCVFit(
        found.astype(np.float64),
        lens,
        np.ravel(per_view).astype(np.float64),
        np.concatenate([np.squeeze(rotvecs, -1), np.squeeze(translations, -1)], 1),
        float(rms),
    )


@contextmanager
def _on_one_thread() -> Iterator[None]:
    """Within, OpenCV adds up in one order: cv2.calibrateCamera's threads add up as they come, and
    where views say little, its steps go elsewhere by what is rounded.
    """
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)
