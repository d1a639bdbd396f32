"""OpenCV's lens, by Zhang's method (cv2.calibrateCamera).

Source: Z. Zhang, A flexible new technique for camera calibration (2000), the paper's reference for
    its own intrinsics.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

import cv2
import numpy as np

from calib.corners.view import View
from calib.intrinsics.advice import NoFitError
from calib.intrinsics.opencv_fit import OpenCVFit
from calib.intrinsics.spatial_target import find_focal
from calib.session.board import Board
from calib.session.lens import COEFFICIENTS

CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 50, 1e-9)

FLAGS = {
    0: cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST,
    4: cv2.CALIB_FIX_K3,
    5: 0,
    8: cv2.CALIB_RATIONAL_MODEL,
    12: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL,
    14: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL | cv2.CALIB_TILTED_MODEL,
}

PRISM_COUNT = 12
"""The number of coefficients of a lens with a thin prism; two more tilt the sensor."""


def fit_opencv(
    views: Sequence[View],
    board: Board,
    size: tuple[int, int],
    count: int,
    focal: float | None = None,
    earlier: Mapping[int, OpenCVFit] | None = None,
) -> OpenCVFit:
    """Fit by Zhang's method, from few coefficients to many: started with all at once, it ends in
    poor local minima.

    Args:
        views: the views.
        board: their board.
        size: width and height of the picture, px.
        count: the number of coefficients.
        focal: px; None to estimate it.
        earlier: such fits of the same views, by their numbers of coefficients.
    """
    solved = dict(earlier or {})
    start = None
    for step in COEFFICIENTS:
        if step > count:
            break
        if step not in solved:
            solved[step] = refine_opencv(views, board, size, step, start, focal)
        start = solved[step]
    return solved[count]


def refine_opencv(
    views: Sequence[View],
    board: Board,
    size: tuple[int, int],
    count: int,
    start: OpenCVFit | None,
    focal: float | None = None,
) -> OpenCVFit:
    """Return the fit from a start, with the focal length (px) held if one is given.

    A joint fit of the rays takes the place of OpenCV's for the tilted sensor, which takes minutes
    there, and for a lens that would have a pole inside the picture.
    """
    if count > PRISM_COUNT and start:
        return _fit_through_rays(views, board, start, count, focal)
    points = board.points_in_space().astype(np.float32)
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
    camera[:2, 2] = np.clip(camera[:2, 2], 1, np.array(size) - 2)  # OpenCV refuses other starts
    guess = 0 if board.is_flat and not (start or focal) else cv2.CALIB_USE_INTRINSIC_GUESS
    if not (start or focal or board.is_flat):
        camera[[0, 1], [0, 1]] = find_focal(board.points(), views, size)[0]
    if focal:
        camera[:2, :2] *= focal / camera[0, 0]
        guess |= cv2.CALIB_FIX_FOCAL_LENGTH
    try:
        with _on_one_thread():
            rms, matrix, distortion, rotvecs, translations, _, _, per_view = (
                cv2.calibrateCameraExtended(
                    objects,
                    pixels,
                    size,
                    camera,
                    coefficients,
                    flags=FLAGS[count] | guess,
                    criteria=CRITERIA,
                )
            )
    except cv2.error as error:
        raise NoFitError() from error
    fit = OpenCVFit(
        matrix.astype(np.float64),
        np.ravel(distortion)[:count].astype(np.float64),
        np.ravel(per_view).astype(np.float64),
        np.concatenate([np.squeeze(rotvecs, -1), np.squeeze(translations, -1)], 1),
        float(rms),
    )
    if start and fit.has_pole:
        return _fit_through_rays(views, board, start, count, focal)
    return fit


def _fit_through_rays(
    views: Sequence[View], board: Board, start: OpenCVFit, count: int, focal: float | None
) -> OpenCVFit:
    from calib.intrinsics.opencv_by_rays import fit_through_rays

    return fit_through_rays(views, board, start, count, focal)


@contextmanager
def _on_one_thread() -> Iterator[None]:
    """Run OpenCV on one thread, so that it always adds up in the same order. The threads of
    cv2.calibrateCamera add up in the order in which they finish, and if the views determine little,
    the rounding changes its steps.
    """
    previous = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(previous)
