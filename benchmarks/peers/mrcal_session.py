"""Debian's mrcal on a session of corners: print the squared errors of kept-back views, JSON, px^2.

Run by /usr/bin/python3, where Debian puts mrcal: KEPT HELD_OUT, two session folders. With --halves,
each half of a view's corners is measured with the pose that the other half gives.
"""

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import cv2
import mrcal  # type: ignore[import-not-found]
import numpy as np
import yaml
from scipy.optimize import least_squares

from fixtures.rig_score import Floats, read_corners

OPENCV8 = "LENSMODEL_OPENCV8"
SPLINED = "LENSMODEL_SPLINED_STEREOGRAPHIC_order=3_Nx=10_Ny=8_fov_x_deg={}"
MARGIN = 1.15
"""The spline's field over that of the picture's width."""
MAX_FIELD = 170
"""Degrees of a spline's field."""


def main() -> None:
    kept, held_out = map(Path, sys.argv[1:3])
    halves = sys.argv[3:] == ["--halves"]
    errors = {}
    focal = 0.0
    document = yaml.safe_load((kept / "session.yaml").read_text())
    width = document["camera"]["width"]
    for name in ("mrcal OPENCV8", "mrcal splined"):
        if name == "mrcal OPENCV8":
            model = OPENCV8
        else:
            field = MARGIN * 2 * math.degrees(math.atan(width / 2 / (focal or width)))
            model = SPLINED.format(min(MAX_FIELD, int(field)))
        with tempfile.TemporaryDirectory() as folder:
            camera = calibrate(kept, document, model, focal or width, Path(folder))
        if camera is None:
            continue
        focal = focal or float(camera.intrinsics()[1][0])
        errors[name] = squared_errors(camera, document["board"], held_out, halves=halves)
    print(json.dumps(errors))


def command_words(
    pictures: Mapping[str, Floats],
    document: dict[str, dict[str, float]],
    model: str,
    focal: float,
    folder: Path,
) -> list[str]:
    """Write the (N, 2) px corners of the pictures into the folder, and return the options of
    mrcal-calibrate-cameras for them, without the pictures' names.
    """
    board, camera = document["board"], document["camera"]
    lines = ["# filename x y level\n"]
    for picture, corners in pictures.items():
        for x, y in corners:
            place = f"{x:.17g} {y:.17g} 0" if math.isfinite(x) else "- - -"
            lines.append(f"{picture} {place}\n")
    (folder / "corners.vnl").write_text("".join(lines))
    options = {
        "--corners-cache": [str(folder / "corners.vnl")],
        "--lensmodel": [model],
        "--focal": [str(focal)],
        "--imagersize": [str(camera["width"]), str(camera["height"])],
        "--object-spacing": [str(side(board))],
        "--object-width-n": [str(board["columns"])],
        "--object-height-n": [str(board["rows"])],
        "--outdir": [str(folder)],
    }
    return [word for name, values in options.items() for word in (name, *values)]


def calibrate(
    session: Path, document: dict[str, dict[str, float]], model: str, focal: float, folder: Path
) -> mrcal.cameramodel | None:
    """Return what mrcal's own command fits, None if it ends without a model."""
    views = read_corners(session / "corners.vnl").values()
    pictures = {f"view{index:04d}.png": corners for index, corners in enumerate(views)}
    words = command_words(pictures, document, model, focal, folder)
    subprocess.run(
        ["mrcal-calibrate-cameras", *words, "view*.png"], capture_output=True, check=False
    )
    file = folder / "camera-0.cameramodel"
    return mrcal.cameramodel(str(file)) if file.exists() else None


def squared_errors(
    camera: mrcal.cameramodel, board: dict[str, float], session: Path, *, halves: bool
) -> dict[str, float]:
    """Return the sum of the squared errors of each of the session's views, px^2."""
    warp = camera.optimization_inputs()["calobject_warp"]
    points = mrcal.ref_calibration_object(
        board["columns"], board["rows"], side(board), calobject_warp=warp
    ).reshape(-1, 3)
    intrinsics = camera.intrinsics()
    squares: dict[str, float] = {}
    for picture, corners in read_corners(session / "corners.vnl").items():
        seen = np.isfinite(corners[:, 0])
        ours, pixels = points[seen], corners[seen]
        rays = mrcal.unproject(pixels, *intrinsics)
        _, turn, place = cv2.solvePnP(
            ours * [1, 1, 0], (rays / rays[:, 2:])[:, :2].copy(), np.eye(3), None
        )

        def residual(pose: Floats, ours: Floats, pixels: Floats) -> Floats:
            moved = mrcal.transform_point_Rt(mrcal.Rt_from_rt(pose), ours)
            return np.ravel(mrcal.project(moved, *intrinsics) - pixels)

        odd = np.arange(len(ours)) % 2 == 1
        squares[picture] = 0.0
        for scored in (odd, ~odd) if halves else (odd | True,):
            fitted = ~scored if halves else scored
            start = np.append(turn, place)
            pose = least_squares(residual, start, args=(ours[fitted], pixels[fitted])).x
            squares[picture] += float((residual(pose, ours[scored], pixels[scored]) ** 2).sum())
    return squares


def side(board: dict[str, float]) -> float:
    """Return the side of a square, m."""
    stated = board["square_mm"]
    return (stated["value"] if isinstance(stated, dict) else stated) / 1000


if __name__ == "__main__":
    main()
