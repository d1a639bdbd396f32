"""lensboy, told what mrcal is told: the focal length, and for a splined lens the number of knots.
All other options are its defaults.
"""

import time
from importlib.metadata import version

import cv2
import lensboy
import numpy as np

from benchmarks.peers.case import CORNERS, Case
from benchmarks.peers.central import Floats, scorer
from benchmarks.peers.child import Fitted, main


def fit(case: Case, which: str) -> Fitted:
    cv2.setNumThreads(1)
    width, height = case.size
    kind, *knots = which.split()
    common = {
        "image_width": width,
        "image_height": height,
        "initial_focal_length": case.focal,
    }
    if kind == "splined":
        columns, rows = map(int, knots)
        config = lensboy.PinholeSplinedConfig(num_knots_x=columns, num_knots_y=rows, **common)
    else:
        config = lensboy.OpenCVConfig(
            included_distortion_coefficients=lensboy.OpenCVConfig.FULL_14, **common
        )
    points = np.arange(len(CORNERS))
    frames = [lensboy.Frame(points, pixels) for pixels in case.train.pixels]
    start_time = time.perf_counter()
    result = lensboy.calibrate_camera(CORNERS, frames, config)
    seconds = time.perf_counter() - start_time
    model = result.camera_model

    def project(points: Floats) -> Floats:
        return np.asarray(model.project_points(points), dtype=np.float64)

    return Fitted(f"lensboy {version('lensboy')}", seconds, None, scorer(project))


if __name__ == "__main__":
    main(fit)
