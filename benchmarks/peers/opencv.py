"""cv2.calibrateCamera with nothing known beforehand, as people call it, but with criteria stated:
the defaults differ between releases.
"""

import time

import cv2
import numpy as np

from benchmarks.peers.case import CORNERS, Case
from benchmarks.peers.central import Floats, scorer
from benchmarks.peers.child import Fitted, main

FLAGS = {
    "5": 0,
    "8": cv2.CALIB_RATIONAL_MODEL,
    "14": cv2.CALIB_RATIONAL_MODEL | cv2.CALIB_THIN_PRISM_MODEL | cv2.CALIB_TILTED_MODEL,
}
CRITERIA = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 30, float(np.finfo(float).eps))
"""The defaults of OpenCV 4. With 100 iterations the errors are the same to 1 %."""


def fit(case: Case, coefficients: str) -> Fitted:
    cv2.setNumThreads(1)
    boards = [CORNERS.astype(np.float32)] * len(case.train.pixels)
    pixels_of_views = [pixels.astype(np.float32)[:, None] for pixels in case.train.pixels]
    start_time = time.perf_counter()
    _, camera, lens, *_ = cv2.calibrateCamera(
        boards, pixels_of_views, case.size, None, None, flags=FLAGS[coefficients], criteria=CRITERIA
    )
    seconds = time.perf_counter() - start_time

    def project(points: Floats) -> Floats:
        return np.asarray(
            cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera, lens)[0], dtype=np.float64
        ).reshape(-1, 2)

    return Fitted(f"OpenCV {cv2.__version__}", seconds, None, scorer(project))


if __name__ == "__main__":
    main(fit)
