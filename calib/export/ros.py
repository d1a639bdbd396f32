"""Write ROS's camera_info file, as camera_calibration_parsers and camera_info_manager read it, with
plumb_bob, rational_polynomial or equidistant.

The file cannot hold the shift of the centre. A comment in it has the command that publishes the
shift to tf2.
"""

import re

import yaml

from calib.export.central import CentralModel
from calib.export.export import ExportedFiles, ExportRequest, export_central


def export(request: ExportRequest) -> ExportedFiles:
    return export_central(request, "camera_info_{}m.yaml", camera_info)


def camera_info(model: CentralModel) -> str:
    """Return the file's text.

    The rectified picture keeps the camera matrix. A name may have letters, digits and underscores.
    """
    rows = model.matrix.tolist()
    name = re.sub(r"\W+", "_", model.name, flags=re.ASCII).strip("_") or "camera"
    content = {
        "image_width": model.width,
        "image_height": model.height,
        "camera_name": name,
        "camera_matrix": _matrix(rows),
        "distortion_model": model.lens.name,
        "distortion_coefficients": _matrix([list(model.distortion)]),
        "rectification_matrix": _matrix([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
        "projection_matrix": _matrix([[*row, 0.0] for row in rows]),
    }
    return (
        model.commented()
        + _publish_comment(model, name)
        + yaml.safe_dump(
            content, sort_keys=False, allow_unicode=True, default_flow_style=None, width=120
        )
    )


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
