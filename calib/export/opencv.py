"""OpenCV: a central camera as FileStorage (YAML or XML), and maps for cv2.remap as float TIFF.

The camera is for cv2.projectPoints and cv2.undistort, or for their namesakes in cv2.fisheye where
distortion_model says fisheye. Points in the calibration's camera frame are projected with rvec and
tvec as they stand there. The maps are exact at their depth.
"""

from pathlib import Path

import cv2
import numpy as np

from calib.export.central import CentralModel
from calib.export.export import Export, Exported, depth_text, export_central, limits
from calib.io.file_set import FileSet
from calib.undistortion.depth_map import DepthMap


def export(wanted: Export) -> Exported:
    suffix = ".xml" if wanted.form.name == "opencv-xml" else ".yaml"
    cameras = export_central(wanted, "camera_{}m" + suffix, lambda model: storage(model, suffix))
    field = wanted.calibration.ray_field()
    maps = [
        write_opencv_maps(field.map_at(depth), wanted.files, depth_text(depth))
        for depth in wanted.depths
    ]
    return Exported(
        tuple(
            path for camera, two in zip(cameras.paths, maps, strict=True) for path in (camera, *two)
        ),
        cameras.models,
        limits(wanted.calibration),
    )


def storage(model: CentralModel, suffix: str) -> str:
    """The text of a FileStorage; `suffix` is .yaml or .xml."""
    file = cv2.FileStorage(suffix, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for line in model.statement:
        file.writeComment(line)
    file.write("camera_name", model.name)
    file.write("image_width", model.width)
    file.write("image_height", model.height)
    file.write("distortion_model", "fisheye" if model.lens.fisheye else "opencv")
    file.write("camera_matrix", model.matrix)
    file.write("distortion_coefficients", np.array([model.distortion]))
    file.write("rvec", np.zeros((3, 1)))
    file.write("tvec", -np.array(model.centre)[:, None] + 0.0)
    for key, misfit in (
        ("misfit_at_depth", model.at),
        ("misfit_at_half_depth", model.half),
        ("misfit_at_double_depth", model.double),
    ):
        file.startWriteStruct(key, cv2.FILE_NODE_MAP)
        file.write("depth_m", misfit.depth)
        file.write("rms_px", misfit.rms_px)
        file.write("worst_px", misfit.worst_px)
        file.endWriteStruct()
    return file.releaseAndGetString()


def write_opencv_maps(made: DepthMap, files: FileSet, depth: str) -> list[Path]:
    """map_x_Zm.tiff and map_y_Zm.tiff: cv2.imread(..., cv2.IMREAD_UNCHANGED) gives (height, width)
    float32, -1 where not valid.
    """
    written = []
    for name, pixels in (("map_x", made.x), ("map_y", made.y)):
        written.append(
            files.write(f"{name}_{depth}m.tiff", cv2.imencode(".tiff", pixels)[1].tobytes())
        )
    return written
