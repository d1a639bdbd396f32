"""The error that OpenCV leaves on the views of a calibration, for a comparison without a cover."""

import cv2
import numpy as np

from calib.calibration import Calibration

FLAGS = {
    5: 0,
    14: cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL | cv2.CALIB_TILTED_MODEL,
}
"""The flags of cv2.calibrateCamera for a lens with that many coefficients."""


def opencv_error(calibration: Calibration, coefficients: int) -> float:
    """Return the root mean square error in px of cv2.calibrateCamera on the same corners."""
    views = [np.asarray(view.seen, bool) for view in calibration.views]
    board = np.column_stack([calibration.board.points(), np.zeros(calibration.board.count)])
    corners = [
        np.asarray(view.corners, np.float32)[seen]
        for view, seen in zip(calibration.views, views, strict=True)
    ]
    points = [np.asarray(board[seen], np.float32) for seen in views]
    size = calibration.camera.width, calibration.camera.height
    start = np.eye(3), np.zeros(coefficients)
    error, *_ = cv2.calibrateCamera(points, corners, size, *start, flags=FLAGS[coefficients])
    return float(error)
