"""A rig that another program calibrated, and its folder: rig.yaml with a session for each camera.

The other program's numbers are starting values. Its intrinsics get the tolerances of declared
ones, and the baseline of a pair the same relative tolerance as a focal length, because the program
knew no cover. The pictures determine all of them far better.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from calib.errors import InputError, harmless
from calib.importing.session_draft import SessionDraft, new_folder, write_session
from calib.io.files import write_atomically
from calib.rig.rig_file import BY_NAME, FORMAT, NAME
from calib.session.camera import Camera, read_camera
from calib.session.cover import Cover
from calib.session.freeing import INTRINSICS, free_parameters
from calib.session.lens import OPENCV
from calib.session.schema import Section
from calib.session.tolerances import FOCAL

Array = NDArray[np.float64]

FARTHEST_M = 10.0
"""m: cameras that see one board are nearer to each other, so a larger number is in another unit."""
NEAREST_M = 1e-4
"""m: cameras that are nearer have no baseline."""

HEAD = """\
# Imported by calib import rig from {source}.
# The program that calibrated it knew no cover. Describe the cover of each camera in its \
session.yaml. If the cameras
# were behind their covers when it calibrated them, its numbers are those of camera and cover \
together: delete
# camera.intrinsics there and baseline_mm here, if they are far off.
"""
REMARK = (
    "camera.intrinsics are those of {source}, with tolerances, so that they are where the fit"
    " starts."
)


@dataclass(frozen=True, slots=True, eq=False)
class ImportedCamera:
    """One camera of the rig, as the other program calibrated it."""

    name: str
    size: tuple[int, int] | None
    """Width and height, px; None if the file does not have them."""
    intrinsics: Mapping[str, object] | None
    """camera.intrinsics as a session.yaml has them; None for a lens that calib does not have."""
    T_camera_first: Array
    """(4, 4) from the first camera's frame, m."""

    @property
    def distance(self) -> float:
        """The distance in m from the first camera."""
        return float(np.linalg.norm(self.T_camera_first[:3, 3]))

    @property
    def angle_deg(self) -> float:
        """The angle in degrees by which it is turned against the first camera."""
        cosine = (np.trace(self.T_camera_first[:3, :3]) - 1) / 2
        return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))

    def check_distance(self, source: Path) -> None:
        """Raise InputError if the distance can only be in another unit."""
        if self.distance > FARTHEST_M:
            raise InputError(
                f"{source}: {self.name} is {self.distance:g} from the first camera, and the unit is"
                f" the metre: calibrate with the squares' side in metres, or write"
                f" {self.distance / 1000:g} for {self.distance:g} mm."
            )

    def camera(self, size: tuple[int, int], source: Path) -> Camera:
        """Return the camera of a session whose pictures have this size, its numbers with their
        tolerances.

        Raises:
            InputError: the calibration is of pictures of another size, or a number is impossible.
        """
        if self.size not in (None, size):
            assert self.size
            raise InputError(
                f"{source}: {self.name} was calibrated with pictures of"
                f" {self.size[0]}x{self.size[1]} px, and these are {size[0]}x{size[1]} px: give"
                " pictures of the same camera mode."
            )
        if self.intrinsics is None:
            return Camera(*size)
        written = {"width": size[0], "height": size[1], "intrinsics": self.intrinsics}
        camera = read_camera(Section(written, str(source), self.name))
        assert camera.intrinsics
        freed, _ = free_parameters(camera.intrinsics, Cover("none", {}), (INTRINSICS,))
        return replace(camera, intrinsics=freed)


@dataclass(frozen=True, slots=True, eq=False)
class ImportedRig:
    """The rig, and the pictures or corners of each camera."""

    source: Path
    """The file that the user named first."""
    cameras: tuple[ImportedCamera, ...]
    sessions: Mapping[str, SessionDraft]
    """The session of each camera, in the order of the cameras."""
    tolerance_ms: float | None = None
    """Pictures belong together whose times differ by no more than this; None: those of one name."""

    def as_mapping(self) -> dict[str, object]:
        """Return the content of rig.yaml."""
        names = [camera.name for camera in self.cameras]
        content: dict[str, object] = {
            "format": FORMAT,
            "cameras": {name: name for name in names},
            "reference": names[0],
            "together": {"tolerance_ms": self.tolerance_ms} if self.tolerance_ms else BY_NAME,
        }
        if len(names) == 2 and self.cameras[1].distance > NEAREST_M:
            millimetres = 1000 * self.cameras[1].distance
            content["baseline_mm"] = {
                "value": round(millimetres, 6),
                "sigma": float(f"{FOCAL.sigma * millimetres:.3g}"),
            }
        return content

    @property
    def comments(self) -> str:
        """The poses of the cameras, which rig.yaml does not hold, as comment lines."""
        first, *others = self.cameras
        lines = [
            f"# {camera.name} is {1000 * camera.distance:.3f} mm from {first.name}, turned by"
            f" {camera.angle_deg:.3f} degrees.\n"
            for camera in others
        ]
        return HEAD.format(source=harmless(self.source.name)) + "".join(lines)


def write_rig(rig: ImportedRig, folder: Path) -> int:
    """Write the whole folder or nothing, and return the number of its pictures or views.

    Raises:
        InputError: the folder is occupied, or a session is not valid.
    """
    remark = REMARK.format(source=rig.source.name)
    count = 0
    with new_folder(folder) as unfinished:
        for name, session in rig.sessions.items():
            remarks = session.remarks
            if session.camera.intrinsics:
                remarks = (*remarks, remark)
            count += write_session(replace(session, remarks=remarks), unfinished / name)
        text = yaml.safe_dump(rig.as_mapping(), sort_keys=False, default_flow_style=None)
        write_atomically(unfinished / NAME, rig.comments + text)
    return count


def intrinsics_mapping(
    focal_and_centre: list[float], lens: list[float], model: str = OPENCV
) -> dict[str, object]:
    """Return camera.intrinsics as session.yaml has them, of fx, fy, cx, cy (px) and
    coefficients.
    """
    fx, fy, cx, cy = focal_and_centre
    mapping: dict[str, object] = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "distortion": lens}
    return mapping if model == OPENCV else {"model": model} | mapping
