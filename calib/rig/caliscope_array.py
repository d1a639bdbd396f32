"""A rig as caliscope's camera array. Its world is the frame of the first camera, in m; caliscope
numbers the cameras from 0 on, and the comments have their names.

Source: CameraArray.from_toml in cameras/camera_array.py of caliscope.
"""

from __future__ import annotations

import cv2

from calib.export.formats import ExportLens
from calib.rig.central_rig import CentralRig

CALISCOPE_LENSES = (ExportLens("standard", 5), ExportLens("fisheye", 4, fisheye=True))


def caliscope_files(rig: CentralRig, depth: str) -> dict[str, str]:
    """Return camera_array_Zm.toml. caliscope reads it under the name camera_array.toml."""
    sections = []
    for number, (name, model) in enumerate(rig.models.items()):
        pose = rig.poses[name]
        entries = {
            "cam_id": number,
            "size": [model.width, model.height],
            "rotation_count": 0,
            "matrix": model.matrix.tolist(),
            "distortions": list(model.distortion),
            "translation": pose[:3, 3].tolist(),
            "rotation": cv2.Rodrigues(pose[:3, :3])[0].ravel().tolist(),
            "fisheye": str(model.lens.fisheye).lower(),
        }
        lines = "".join(f"{key} = {value}\n" for key, value in entries.items())
        sections.append(f"# {name}\n[cameras.{number}]\n{lines}")
    return {f"camera_array_{depth}m.toml": rig.comments + "\n" + "\n".join(sections)}
