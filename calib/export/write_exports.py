"""Files for every depth that was asked for."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from calib.calibration import Calibration
from calib.export.central import CentralModel, best_central
from calib.export.colmap import cameras_txt
from calib.export.formats import ExportLens
from calib.export.kalibr import camchain
from calib.export.mrcal import cameramodel
from calib.export.npz import depth_text
from calib.export.opencv import storage, write_opencv_maps
from calib.export.ros import camera_info
from calib.export.stmap import write_stmaps
from calib.io.files import make_folder, write_atomically
from calib.progress import Progress

CENTRAL: Mapping[str, tuple[str, Callable[[CentralModel], str]]] = {
    "opencv": ("camera_{}m.yaml", lambda model: storage(model, ".yaml")),
    "opencv-xml": ("camera_{}m.xml", lambda model: storage(model, ".xml")),
    "ros": ("camera_info_{}m.yaml", camera_info),
    "kalibr": ("camchain_{}m.yaml", camchain),
    "colmap": ("cameras_{}m.txt", cameras_txt),
    "mrcal": ("camera_{}m.cameramodel", cameramodel),
}
"""By format: the file's name, with the depth in its place, and its text."""


def write_central(
    calibration: Calibration, form: str, lenses: Sequence[ExportLens], depths: Sequence[float], folder: Path, progress: Progress
) -> tuple[list[Path], list[CentralModel]]:
    """Write a central camera for each depth (m), the best of these lenses; OpenCV's formats get their maps too.

    Returns:
        The paths, and the camera of each depth.
    """
    make_folder(folder)
    depths = tuple(dict.fromkeys(depths))
    advance = progress.task("Central cameras", len(depths))
    name, text = CENTRAL[form]
    field = calibration.ray_field() if form.startswith("opencv") else None
    written, models = [], []
    for done, depth in enumerate(depths, start=1):
        model = best_central(calibration, depth, lenses)
        models.append(model)
        written.append(folder / name.format(depth_text(depth)))
        write_atomically(written[-1], text(model))
        if field:
            written += write_opencv_maps(field.map_at(depth), folder, depth_text(depth))
        advance(done, f"{depth_text(depth)} m")
    return written, models


def write_maps(calibration: Calibration, form: str, depths: Sequence[float], folder: Path, progress: Progress) -> list[Path]:
    """Write the STMaps of each depth (m), and return their paths."""
    make_folder(folder)
    depths = tuple(dict.fromkeys(depths))
    advance = progress.task("STMaps", len(depths))
    field = calibration.ray_field()
    suffix = ".exr" if form == "stmap-exr" else ".tiff"
    written: list[Path] = []
    for done, depth in enumerate(depths, start=1):
        written += write_stmaps(field, depth, folder, depth_text(depth), suffix)
        advance(done, f"{depth_text(depth)} m")
    return written
