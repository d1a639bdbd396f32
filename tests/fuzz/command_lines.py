"""Good command lines over the files of a bench, each of which ends within a second."""

from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np


def good_lines(folder: Path, tables: Sequence[bytes]) -> Sequence[Sequence[str]]:
    """Return good command lines of calib and of capture; their output goes below the folder that
    they run in.

    Args:
        folder: with `session` (too few views for a fit), `small` (a calibration of 64x48 px) and
            `calibration`.
        tables: points and poses, for calib measure.
    """
    source = folder / "given"
    source.mkdir(exist_ok=True)
    cv2.imwrite(str(source / "a.png"), np.full((48, 64), 99, np.uint8))
    cv2.imwrite(str(source / "far.png"), np.full((48, 64), 1000, np.uint16))
    marker = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50).generateImageMarker(3, 24)
    cv2.imwrite(str(source / "tag.png"), np.pad(marker, ((12, 12), (20, 20)), constant_values=255))
    for name, table in zip(("points", "poses"), tables, strict=True):
        (source / f"{name}.csv").write_bytes(table)
    session = str(folder / "session")
    small = str(folder / "small")
    fitted = str(folder / "calibration")
    board = ("--board", "6x5", "--square-mm", "20")
    lines = (
        (
            f"calib fit {session} --method joint --grid 4x4 --free auto --effects none --folds 2"
            " --depth 1 -o out --json"
        ),
        f"calib evaluate {fitted} {session} --json",
        f"calib check {fitted} {session} --json",
        f"calib check {fitted} {session} --update -o out",
        f"calib export {small} --format ros --lens plumb_bob --depth 1 -o out",
        f"calib export {small} --format kalibr --depth 1 -o out",
        f"calib export {small} --format ray-image --axes opengl -o out",
        f"calib immerse {fitted} --outside-index 1.34 --index-sigma 0.001 --depth 1 -o out --json",
        f"calib immerse {fitted} --salinity 35 --temperature 10 --wavelength 500 -o out",
        f"calib undistort {small} {source}/a.png --depth 1 --crop 0 --size 32x24 -o out",
        (
            f"calib undistort {small} {source}/a.png --depth-image {source}/far.png --size 64x48"
            " --near 0.1 -o out"
        ),
        f"calib measure {fitted} {source}/points.csv --depth 1 --noise 0.1 --json",
        f"calib measure {fitted} {source}/points.csv --on-boards --poses {source}/poses.csv",
        (
            f"calib pose {small} {source}/tag.png --tags DICT_4X4_50 --size-mm 50 --size-sigma-mm"
            " 0.1 --border 1 -o out.csv --json"
        ),
        f"calib pose {small} {source}/a.png {source}/tag.png --tags DICT_4X4_50 --size-mm 50",
        "calib board --columns 6 --rows 5 --square-mm 20 --paper A4 --size 64x48 -o out --json",
        (
            "calib board --type charuco --columns 6 --rows 5 --marker 0.7 --dictionary DICT_4X4_250"
            " --legacy-pattern -o out"
        ),
        "calib board --type aprilgrid --tag-mm 20 --spacing 0.3 --paper 600x400 -o out",
        f"calib import mrcal-corners {session}/corners.vnl --size 320x240 {' '.join(board)} -o out",
        f"calib import images {session}/frames {' '.join(board)} -o out",
        f"capture record out --source folder:{session}/frames {' '.join(board)} --views 2",
    )
    return [line.split() for line in lines]
