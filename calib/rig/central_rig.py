"""Central cameras in the place of a rig's covered ones, for programs that know no cover.

A central camera has its origin where the rays of the covered camera come nearest to meeting, so the
transforms lead between these points.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from calib.errors import InputError
from calib.export.central import CentralModel, best_central
from calib.export.formats import ExportLens
from calib.rig.poses import pose_matrix
from calib.rig.rig import Rig

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class RigFrame:
    """One placement of the board, with the pictures that show it."""

    T_reference_board: Array
    """(4, 4)"""
    pictures: Mapping[str, str]
    """The file's name by the name of the camera."""


@dataclass(frozen=True, slots=True, eq=False)
class CentralRig:
    """The central cameras of a rig."""

    models: Mapping[str, CentralModel]
    from_reference: Mapping[str, Array]
    """(4, 4) from the frame of the rig's reference camera to that of each model."""
    frames: tuple[RigFrame, ...] = ()
    """The placements that the cameras saw."""

    @property
    def poses(self) -> dict[str, Array]:
        """(4, 4) from the frame of the first model to that of each."""
        first = next(iter(self.models))
        to_reference = np.linalg.inv(self.from_reference[first])
        return {name: pose @ to_reference for name, pose in self.from_reference.items()}

    @property
    def statements(self) -> tuple[str, ...]:
        """The statements of all models, each line with the camera's name."""
        return tuple(
            f"{name}: {line}" for name, model in self.models.items() for line in model.statement
        )

    @property
    def comments(self) -> str:
        """The statements as comment lines that start with #."""
        return "".join(f"# {line}\n" for line in self.statements)

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
        return CentralRig(models, from_reference, _frames(rig, names))


def rectified(rig: CentralRig) -> tuple[Array, ...]:
    """Return R1, R2, P1, P2 and Q of cv2.stereoRectify for a pair.

    Raises:
        InputError: the rig is no pair, or a camera has a fisheye lens.
    """
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


def _frames(rig: Rig, names: tuple[str, ...]) -> tuple[RigFrame, ...]:
    """Return the placements that at least one of the named cameras saw."""
    pictures: dict[int, dict[str, str]] = {}
    for name in names:
        views = rig.calibrations[name].views
        for view, place in zip(views, rig.of_views[name].tolist(), strict=True):
            pictures.setdefault(place, {})[name] = view.name
    return tuple(
        RigFrame(pose_matrix(torch.from_numpy(rig.placements[place])), pictures[place])
        for place in sorted(pictures)
    )
