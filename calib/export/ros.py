"""ROS: the camera_info file of camera_calibration_parsers and camera_info_manager, with plumb_bob,
rational_polynomial or equidistant.

The shift of the centre has no place in it: a comment has the command that publishes it to tf2.
"""

import re

import yaml

from calib.export.central import CentralModel
from calib.export.export import Export, Exported, export_central


def export(wanted: Export) -> Exported:
    return export_central(wanted, "camera_info_{}m.yaml", camera_info)


def camera_info(model: CentralModel) -> str:
    """The file's text.

    The rectified picture keeps the camera matrix; a name may have letters, digits and underscores.
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
        + _published(model, name)
        + yaml.safe_dump(
            content, sort_keys=False, allow_unicode=True, default_flow_style=None, width=120
        )
    )


def _published(model: CentralModel, name: str) -> str:
    """Comments with the command that says where the camera stands; none where it stands at the
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
    return {
        "rows": len(rows),
        "cols": len(rows[0]),
        "data": [number for row in rows for number in row],
    }
