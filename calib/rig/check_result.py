"""The result of the check of a rig, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.checking.result import NO_STATISTICS, Change, CheckResult, CheckStatistics, CheckStatus
from calib.checking.significance import ALPHA
from calib.rig.rig_content import RejectedView

Array = NDArray[np.float64]


CONTRADICTION = "contradicting_pictures"
"""The name of the finding that the pictures of a camera do not agree on where it is."""


@dataclass(frozen=True, slots=True)
class RigChange:
    """A possible change of a rig."""

    camera: str
    """The camera that changed; empty if no camera has a name."""
    change: Change
    """What changed: moved, turned, moved_and_turned, or a change of the camera itself."""
    from_file: str = ""
    """The first picture after the change; empty if it holds for all pictures."""

    def as_json(self) -> dict[str, object]:
        return {"camera": self.camera, "from_file": self.from_file} | self.change.as_json()


@dataclass(frozen=True, slots=True, eq=False)
class CameraPlace:
    """The pose of a camera in later placements against the calibrated one, with the poses of all
    other cameras free as well.
    """

    T_camera_reference: Array
    """(4, 4) the new pose."""
    motion: Array
    """(6,) how the camera turned (rad) and moved (m), in its own calibrated frame."""
    sigma: Array
    """(6,) standard deviations, with those of the calibrated rig."""
    turned: tuple[float, float]
    """rad: the angle of the turn, and its standard deviation."""
    moved: tuple[float, float]
    """m: the length of the move, and its standard deviation."""
    p_value: float
    """The probability of a motion as significant by chance."""
    z: float
    """The same, as the number of standard deviations of a normal variable."""

    def as_json(self) -> dict[str, object]:
        turn, shift = self.motion[:3], self.motion[3:]
        return {
            "T_camera_reference": self.T_camera_reference.tolist(),
            "moved_mm": _with_sigma(1000 * self.moved[0], 1000 * self.moved[1]),
            "turned_deg": _with_sigma(*np.degrees(self.turned).tolist()),
            "motion": [*turn.tolist(), *shift.tolist()],
            "sigma": self.sigma.tolist(),
            "p_value": self.p_value,
            "z": self.z,
        }


@dataclass(frozen=True, slots=True, eq=False)
class RigCheckResult:
    """Whether a calibrated rig still holds, and what has changed."""

    status: CheckStatus
    p_value: float
    """The p-value of all questions together: of each camera by itself, and of their mountings. At
    most a fraction ALPHA of the checks of an unchanged rig has a smaller one.
    """
    statistics: CheckStatistics | None
    """The test of the mountings, by the placements that several cameras saw; None where no two
    cameras could be compared.
    """
    changes: tuple[RigChange, ...]
    """Those of cameras whose own calibration no longer holds, then those of the mountings, the most
    probable first.
    """
    cameras: Mapping[str, CheckResult]
    """The check of each camera by itself."""
    places: Mapping[str, CameraPlace]
    """The poses of the cameras that were compared with `base`."""
    base: str
    """The camera against which poses are compared: the reference, if the placements show it."""
    unplaced: Mapping[str, str]
    """The cameras whose poses are not compared, and the reasons."""
    placements: int
    """The placements that several cameras saw."""
    rejected: tuple[RejectedView, ...]

    @property
    def is_pair(self) -> bool:
        """True if two cameras were compared: then a motion of one is one of the other as well."""
        return len(self.places) == 1

    @property
    def is_known(self) -> bool:
        """True if each camera was fitted to most of its pictures, which cannot contradict it."""
        return all(result.is_known for result in self.cameras.values())

    def as_json(self) -> dict[str, object]:
        cameras: dict[str, object] = {
            name: {
                "own": result.as_json(),
                "place": self.places[name].as_json() if name in self.places else None,
                "not_compared": self.unplaced.get(name, ""),
            }
            for name, result in self.cameras.items()
        }
        lacking = next((r.lacking for r in self.cameras.values() if r.lacking), "")
        return (
            {"answer": self.status.value}
            | (self.statistics.as_json() if self.statistics else NO_STATISTICS)
            | {
                "p_value": self.p_value,
                "false_alarm_rate": ALPHA,
                "placements": self.placements,
                "reference": self.base,
                "cameras": cameras,
                "frames_rejected": [
                    {"camera": view.camera, "file": view.file, "reason": view.reason}
                    for view in self.rejected
                ],
                "changes": [change.as_json() for change in self.changes],
                "lacking": lacking,
            }
        )


def _with_sigma(value: float, sigma: float) -> dict[str, float]:
    return {"value": value, "sigma": sigma}
