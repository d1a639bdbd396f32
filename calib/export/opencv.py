"""Write OpenCV's files: a central camera as FileStorage (YAML or XML), and maps for cv2.remap as
float TIFF.

The camera is for cv2.projectPoints and cv2.undistort, or for the functions of the same names in
cv2.fisheye if distortion_model is fisheye. With rvec and tvec as they are in the file, points in
the calibration's camera frame are projected. The maps are exact at their depth.
"""

from pathlib import Path

import cv2
import numpy as np

from calib.export.central import CentralModel
from calib.export.export import (
    ExportedFiles,
    ExportRequest,
    export_central,
    limit_remarks,
)
from calib.io.file_set import FileSet
from calib.io.numerals import depth_text
from calib.undistortion.depth_map import DepthMap


def export(request: ExportRequest) -> ExportedFiles:
    suffix = ".xml" if request.form.name == "opencv-xml" else ".yaml"
    cameras = export_central(request, "camera_{}m" + suffix, lambda model: storage(model, suffix))
    field = request.calibration.ray_field()
    maps = [
        write_opencv_maps(field.map_at(depth), request.files, depth_text(depth))
        for depth in request.depths
    ]
    return ExportedFiles(
        tuple(
            path
            for camera, map_paths in zip(cameras.paths, maps, strict=True)
            for path in (camera, *map_paths)
        ),
        cameras.models,
        limit_remarks(request.calibration),
    )


def storage(model: CentralModel, suffix: str) -> str:
    """Return the text of a FileStorage; `suffix` is .yaml or .xml."""
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
        ("misfit_at_depth", model.misfit_at_depth),
        ("misfit_at_half_depth", model.misfit_at_half_depth),
        ("misfit_at_double_depth", model.misfit_at_double_depth),
    ):
        file.startWriteStruct(key, cv2.FILE_NODE_MAP)
        file.write("depth_m", misfit.depth)
        file.write("rms_px", misfit.rms_px)
        file.write("worst_px", misfit.worst_px)
        file.endWriteStruct()
    return file.releaseAndGetString()


def write_opencv_maps(depth_map: DepthMap, files: FileSet, depth: str) -> list[Path]:
    """Write map_x_Zm.tiff and map_y_Zm.tiff. cv2.imread(..., cv2.IMREAD_UNCHANGED) reads (height,
    width) float32, -1 where not valid.
    """
    written = []
    for name, pixels in (("map_x", depth_map.x), ("map_y", depth_map.y)):
        written.append(
            files.write(f"{name}_{depth}m.tiff", cv2.imencode(".tiff", pixels)[1].tobytes())
        )
    return written
