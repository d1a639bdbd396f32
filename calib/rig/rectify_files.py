"""The files of a rectified pair and of a depth picture."""

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from calib.io.files import npz
from calib.io.numerals import depth_text
from calib.rig.depth import DepthPicture
from calib.rig.rectify import RectifiedPair

DEPTH_UNIT = 1e-4
"""m: the unit of the 16-bit depth picture, whose farthest depth is 6.55 m."""
FARTHEST = 65535


def rectification_files(pair: RectifiedPair) -> dict[str, bytes | memoryview | str]:
    """Return the files by their names: for each camera the maps for cv2.remap, and
    rectified_Zm.yaml with the pinholes.
    """
    depth = depth_text(pair.depth)
    files: dict[str, bytes | memoryview | str] = {}
    for name, (map_x, map_y) in zip(pair.names, pair.maps, strict=True):
        files[f"rectify_{name}_{depth}m.npz"] = npz({"map_x": map_x, "map_y": map_y})
    first, second = pair.projections
    content = {
        "left": pair.names[0],
        "right": pair.names[1],
        "depth_m": pair.depth,
        "image_width": pair.size[0],
        "image_height": pair.size[1],
        "baseline_m": pair.baseline,
        "rotation_from_reference": pair.rotation.tolist(),
        "centres_m": [centre.tolist() for centre in pair.centres],
        "P1": first.tolist(),
        "P2": second.tolist(),
        "rows": [
            {"depth_m": row.depth, "rms_px": row.rms_px, "worst_px": row.worst_px}
            for row in pair.rows
        ],
    }
    files[f"rectified_{depth}m.yaml"] = yaml.safe_dump(
        content, sort_keys=False, default_flow_style=None, width=120
    )
    return files


def depth_files(picture: DepthPicture) -> dict[str, bytes | memoryview | str]:
    """Return depth.npz with depth and sigma in m and the points, and depth.png with 16 bits in
    tenths of a millimetre, 0 where there is no depth.
    """
    counts = np.nan_to_num(picture.depth / DEPTH_UNIT, nan=0.0)
    counts = np.where(counts <= FARTHEST, np.rint(counts), 0).astype(np.uint16)
    arrays: dict[str, NDArray] = {
        "depth": picture.depth,
        "sigma": picture.sigma,
        "points": picture.points,
    }
    return {"depth.npz": npz(arrays), "depth.png": cv2.imencode(".png", counts)[1].tobytes()}
