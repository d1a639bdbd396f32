"""NumPy files: the ray field, and maps for cv2.remap.

rays.npz: nodes_x (w,), nodes_y (h,) px; infinite (h, w, 2) px and parallax (h, w, 2) px m, so that the undistorted pixel at depth Z of
the distorted pixel at a node is infinite + parallax / Z; valid (h, w).
map_Zm.npz: map_x, map_y (height, width) float32 for cv2.remap, -1 where not valid; valid (height, width); depth_m.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from calib.calibration import Calibration
from calib.files import make_folder, save_npz
from calib.maps import DepthMap, RayField
from calib.progress import Progress


def write_npz(calibration: Calibration, depths: Sequence[float], folder: Path, progress: Progress) -> list[Path]:
    """Write rays.npz and one map file for each depth (m), and return their paths."""
    make_folder(folder)
    advance = progress.task("Maps", 1 + len(depths))
    field = calibration.ray_field()
    written = [_write_field(field, folder)]
    for done, depth in enumerate(dict.fromkeys(depths), start=1):
        advance(done, f"{depth:g} m")
        written.append(_write_map(field.map_at(depth), folder))
    advance(1 + len(depths), "")
    return written


def read_field(path: Path, width: int, height: int) -> RayField:
    """The field of a rays.npz, for an image of width x height px."""
    with np.load(path, allow_pickle=False) as file:
        return RayField(width, height, *(file[name] for name in ("nodes_x", "nodes_y", "infinite", "parallax", "valid")))


def _write_field(field: RayField, folder: Path) -> Path:
    path = folder / "rays.npz"
    names = ("nodes_x", "nodes_y", "infinite", "parallax", "valid")
    save_npz(path, {name: getattr(field, name) for name in names})
    return path


def _write_map(made: DepthMap, folder: Path) -> Path:
    path = folder / f"map_{made.depth:g}m.npz"
    arrays = {"map_x": made.x, "map_y": made.y, "valid": made.valid, "depth_m": np.float64(made.depth)}
    save_npz(path, {name: np.asarray(array) for name, array in arrays.items()}, compressed=False)
    return path
