"""Write NumPy files: the ray field, and maps for cv2.remap.

rays.npz has: width and height px of the image; fx, fy, cx, cy px of the undistorted picture;
nodes_x (w,) and nodes_y (h,) px; at_infinity (h, w, 2) px and parallax (h, w, 2) px m; valid (h,
w); nearest (h, w) m, the distance in front of the camera at which each ray leaves the cover. The
undistorted pixel at depth Z of the distorted pixel at a node is at_infinity + parallax / Z. Where
the fit estimated an uncertainty, it also has sigma_x (m,) and sigma_y (n,) px and variance (n, m,
3). The predicted variance of the undistorted position at those distorted pixels is variance[..., 0]
+ variance[..., 1] / Z + variance[..., 2] / Z^2, px^2, x and y together (calib.apply).

map_Zm.npz has: map_x and map_y (height, width) float32 for cv2.remap, -1 where not valid; valid
(height, width); depth_m; and, where the fit estimated an uncertainty, sigma (height, width) float32
px, the standard deviation of each pixel's position, NaN where not valid.

Both have calibration, the SHA-256 of the calibration.npz from which they were made.
"""

from collections.abc import Sequence
from hashlib import sha256
from pathlib import Path

import numpy as np

from calib.apply.map_uncertainty import SigmaField, predicted_sigma
from calib.calibration import Calibration
from calib.errors import InputError
from calib.export.export import ExportedFiles, ExportRequest, limit_remarks
from calib.io.file_set import FileSet, find_current
from calib.io.files import npz
from calib.io.numerals import depth_text
from calib.io.result_names import CALIBRATION_ARRAYS
from calib.progress import Progress
from calib.undistortion.depth_map import DepthMap
from calib.undistortion.ray_field import RayField

ARRAYS = ("nodes_x", "nodes_y", "at_infinity", "parallax", "valid", "nearest")


def export(request: ExportRequest) -> ExportedFiles:
    return ExportedFiles(
        tuple(write_npz(request.calibration, request.depths, request.files, request.progress)),
        remarks=limit_remarks(request.calibration),
    )


def write_npz(
    calibration: Calibration, depths: Sequence[float], files: FileSet, progress: Progress
) -> list[Path]:
    """Write rays.npz and one map file for each depth (m), and return their paths."""
    advance = progress.task("Rays and maps", 1 + len(depths))
    field = calibration.ray_field()
    sigma = predicted_sigma(calibration)
    written = [_write_field(field, sigma, calibration, files)]
    for done, depth in enumerate(dict.fromkeys(depths), start=1):
        advance(done, f"{depth_text(depth)} m")
        written.append(_write_map(field.map_at(depth), sigma, calibration, files))
    advance(1 + len(depths), "")
    return written


def npz_file_names(depths: Sequence[float]) -> list[str]:
    """Return the names of the files that `write_npz` writes."""
    return ["rays.npz", *(f"map_{depth_text(depth)}m.npz" for depth in depths)]


def read_field(path: Path) -> RayField:
    """Return the field of a rays.npz; raise InputError if the calibration.npz beside it is another
    one.
    """
    with np.load(find_current(path), allow_pickle=False) as file:
        calibration_file = find_current(path.with_name(CALIBRATION_ARRAYS))
        if (
            calibration_file.exists()
            and sha256(calibration_file.read_bytes()).hexdigest() != file["calibration"]
        ):
            raise InputError(
                f"{path} was made from another calibration than the one beside it: write it again"
                " by `calib export`."
            )
        return RayField(int(file["width"]), int(file["height"]), *(file[name] for name in ARRAYS))


def _write_field(
    field: RayField, sigma: SigmaField | None, calibration: Calibration, files: FileSet
) -> Path:
    intrinsics = calibration.camera.intrinsics
    assert intrinsics
    pinhole = {name: getattr(intrinsics, name).value for name in ("fx", "fy", "cx", "cy")}
    scalars = {"width": field.width, "height": field.height, **pinhole}
    digest = {"calibration": np.asarray(calibration.digest)}
    arrays = (
        digest
        | {name: np.asarray(number) for name, number in scalars.items()}
        | {name: getattr(field, name) for name in ARRAYS}
    )
    if sigma:
        arrays |= {"sigma_x": sigma.nodes_x, "sigma_y": sigma.nodes_y, "variance": sigma.variance}
    return files.write("rays.npz", npz(arrays))


def _write_map(
    depth_map: DepthMap, sigma: SigmaField | None, calibration: Calibration, files: FileSet
) -> Path:
    arrays = {
        "calibration": calibration.digest,
        "map_x": depth_map.x,
        "map_y": depth_map.y,
        "valid": depth_map.valid,
        "depth_m": np.float64(depth_map.depth),
    }
    if sigma:
        arrays["sigma"] = sigma.of_map(depth_map)
    content = npz({name: np.asarray(array) for name, array in arrays.items()}, compressed=False)
    return files.write(f"map_{depth_text(depth_map.depth)}m.npz", content)
