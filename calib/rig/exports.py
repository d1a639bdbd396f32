"""A rig for other programs: each camera as the central one that is nearest to it at a depth, and
the transforms between them.

A central camera has its origin where the rays of the covered camera come nearest to meeting, so the
transforms lead between these points. Every file says how far each model is off.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from calib.errors import InputError
from calib.export.central import CentralModel, best_central
from calib.export.formats import ROS, ExportLens
from calib.export.kalibr import camera_entry
from calib.export.ros import camera_content
from calib.rig.rig import Rig

Array = NDArray[np.float64]
STEREO_LENSES = (
    ExportLens("opencv", 5),
    ExportLens("opencv", 8),
    ExportLens("opencv", 12),
)
"""The lenses that cv2.stereoRectify takes."""
KALIBR_LENSES = (ExportLens("radtan", 4), ExportLens("equidistant", 4, fisheye=True))


@dataclass(frozen=True, slots=True, eq=False)
class CentralRig:
    """The central cameras of a rig."""

    models: Mapping[str, CentralModel]
    poses: Mapping[str, Array]
    """(4, 4) from the frame of the first model to that of each."""

    @property
    def comments(self) -> str:
        """The statements of all models, as comment lines."""
        return "".join(
            f"# {name}: {line}\n" for name, model in self.models.items() for line in model.statement
        )

    def pair(self) -> tuple[tuple[str, CentralModel], tuple[str, CentralModel]]:
        """Return both cameras of a pair with their names.

        Raises:
            InputError: the rig is no pair.
        """
        if len(self.models) != 2:
            raise InputError(
                f"This format holds a pair of cameras, and the rig has {len(self.models)}: choose"
                " kalibr, or name two cameras with --pair."
            )
        first, second = self.models.items()
        return first, second

    @staticmethod
    def of(
        rig: Rig, names: tuple[str, ...], depth: float, lenses: tuple[ExportLens, ...]
    ) -> CentralRig:
        """Return the central cameras that are nearest to those of a rig at a depth in m."""
        models = {name: best_central(rig.calibrations[name], depth, lenses) for name in names}
        from_reference = {}
        for name, model in models.items():
            pose = rig.mounting(name).T_camera_reference.copy()
            pose[:3, 3] -= model.centre
            from_reference[name] = pose
        to_reference = np.linalg.inv(from_reference[names[0]])
        poses = {name: pose @ to_reference for name, pose in from_reference.items()}
        return CentralRig(models, poses)


@dataclass(frozen=True, slots=True)
class RigFormat:
    """One value of `calib rig export --format`."""

    name: str
    summary: str
    lenses: tuple[ExportLens, ...]
    files: Callable[[CentralRig, str], dict[str, str]]
    """A function that returns the texts by the files' names, for a depth as names have it."""


def opencv_files(rig: CentralRig, depth: str) -> dict[str, str]:
    """Return stereo_Zm.yml as cv2.FileStorage reads it, with the names of OpenCV's stereo sample:
    M1, D1, M2, D2, R, T and, of cv2.stereoRectify, R1, R2, P1, P2, Q.
    """
    (_, first), (name, second) = rig.pair()
    pose = rig.poses[name]
    rectified = _rectified(rig)
    file = cv2.FileStorage(".yml", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    for line in rig.comments.splitlines():
        file.writeComment(line.removeprefix("# "))
    file.write("image_width", first.width)
    file.write("image_height", first.height)
    values = {
        "M1": first.matrix,
        "D1": np.array([first.distortion]),
        "M2": second.matrix,
        "D2": np.array([second.distortion]),
        "R": pose[:3, :3],
        "T": pose[:3, 3:],
        **dict(zip(("R1", "R2", "P1", "P2", "Q"), rectified, strict=True)),
    }
    for key, value in values.items():
        file.write(key, np.ascontiguousarray(value))
    return {f"stereo_{depth}m.yml": file.releaseAndGetString()}


def ros_files(rig: CentralRig, depth: str) -> dict[str, str]:
    """Return a camera_info of each camera of a pair, with the rectification and the projection that
    stereo_image_proc takes: P of the second camera has -fx baseline.
    """
    cameras = rig.pair()
    first_turn, second_turn, first_projection, second_projection, _ = _rectified(rig)
    turns = first_turn, second_turn
    projections = first_projection, second_projection
    texts = {}
    for (name, model), turn, projection in zip(cameras, turns, projections, strict=True):
        content = camera_content(model, name, turn, projection)
        texts[f"{name}_{depth}m.yaml"] = model.commented() + yaml.safe_dump(
            content, sort_keys=False, default_flow_style=None, width=120
        )
    return texts


def kalibr_files(rig: CentralRig, depth: str) -> dict[str, str]:
    """Return Kalibr's camchain of all cameras, each with T_cn_cnm1 from the camera before it."""
    chain = {}
    previous = np.eye(4)
    for index, (name, model) in enumerate(rig.models.items()):
        overlaps = [other for other in range(len(rig.models)) if other != index]
        entry = camera_entry(model, f"/{name}/image_raw") | {"cam_overlaps": overlaps}
        if index:
            entry["T_cn_cnm1"] = (rig.poses[name] @ np.linalg.inv(previous)).tolist()
        previous = rig.poses[name]
        chain[f"cam{index}"] = entry
    text = yaml.safe_dump(chain, sort_keys=False, default_flow_style=None, width=120)
    return {f"camchain_{depth}m.yaml": rig.comments + text}


RIG_FORMATS = (
    RigFormat("opencv", "stereo.yml of cv2.stereoCalibrate's names", STEREO_LENSES, opencv_files),
    RigFormat("ros", "a camera_info of each camera of a pair", ROS, ros_files),
    RigFormat("kalibr", "a camchain of all cameras", KALIBR_LENSES, kalibr_files),
)
"""The formats, in the order of the help."""


def _rectified(rig: CentralRig) -> tuple[Array, ...]:
    """Return R1, R2, P1, P2 and Q of cv2.stereoRectify."""
    (_, first), (name, second) = rig.pair()
    pose = rig.poses[name]
    if first.lens.fisheye or second.lens.fisheye:
        raise InputError(
            "These cameras need a fisheye lens, which this format does not rectify: choose kalibr."
        )
    results = cv2.stereoRectify(
        first.matrix,
        np.array(first.distortion),
        second.matrix,
        np.array(second.distortion),
        (first.width, first.height),
        np.ascontiguousarray(pose[:3, :3]),
        np.ascontiguousarray(pose[:3, 3:]),
        alpha=0,
    )
    return tuple(np.asarray(matrix, np.float64) for matrix in results[:5])
