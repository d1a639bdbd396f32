"""Write ROS's camera_info file, as camera_calibration_parsers and camera_info_manager read it, with
plumb_bob, rational_polynomial or equidistant.

The file cannot hold the shift of the centre. A comment in it has the command that publishes the
shift to tf2.
"""

import re

import numpy as np
import yaml
from numpy.typing import NDArray

from calib.export.central import CentralModel
from calib.export.export import ExportedFiles, ExportRequest, export_central

Array = NDArray[np.float64]


def export(request: ExportRequest) -> ExportedFiles:
    return export_central(request, "camera_info_{}m.yaml", camera_info)


def camera_info(model: CentralModel) -> str:
    """Return the file's text.

    The rectified picture keeps the camera matrix. A name may have letters, digits and underscores.
    """
    name = re.sub(r"\W+", "_", model.name, flags=re.ASCII).strip("_") or "camera"
    projection = np.column_stack([model.matrix, np.zeros(3)])
    content = camera_content(model, name, np.eye(3), projection)
    return (
        model.commented()
        + _publish_comment(model, name)
        + yaml.safe_dump(
            content, sort_keys=False, allow_unicode=True, default_flow_style=None, width=120
        )
    )


def camera_content(
    model: CentralModel, name: str, rectification: Array, projection: Array
) -> dict[str, object]:
    """Return the file's content.

    Args:
        rectification: (3, 3) from the camera's frame to the rectified one.
        projection: (3, 4) px, of the rectified picture.
    """
    return {
        "image_width": model.width,
        "image_height": model.height,
        "camera_name": name,
        "camera_matrix": _matrix(model.matrix.tolist()),
        "distortion_model": model.lens.name,
        "distortion_coefficients": _matrix([list(model.distortion)]),
        "rectification_matrix": _matrix(rectification.tolist()),
        "projection_matrix": _matrix(projection.tolist()),
    }


def _publish_comment(model: CentralModel, name: str) -> str:
    """Return comments with the command that publishes the camera's place; "" if it is the
    calibration's own origin.
    """
    if not any(model.centre):
        return ""
    x, y, z = model.centre
    frames = f"--frame-id {name}_calibration --child-frame-id {name}_optical_frame"
    return (
        "# Publish that shift, where the child is the frame of the pictures' headers and the"
        " parent the calibration's camera frame:\n# ros2 run tf2_ros static_transform_publisher"
        f" --x {x!r} --y {y!r} --z {z!r} {frames}\n"
    )


def _matrix(rows: list[list[float]]) -> dict[str, object]:
    """Return a matrix as the file has it."""
    return {
        "rows": len(rows),
        "cols": len(rows[0]),
        "data": [number for row in rows for number in row],
    }
