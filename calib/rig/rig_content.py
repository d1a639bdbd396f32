"""The numbers of a calibrated rig: its cameras, where they are mounted, their joint covariance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.diagnosis.finding import ParameterEstimate
from calib.errors import InputError, brief, harmless
from calib.rig.placements import Indices
from calib.session.schema import Number
from calib.version import VERSION

Array = NDArray[np.float64]


INCONSISTENT = "the board does not stand where the other cameras see it at that moment"
OUTLYING = "its error does not fit that of the other views of the rig"
DISAGREEING = (INCONSISTENT, OUTLYING)
"""The reasons of views that contradict the rig."""


@dataclass(frozen=True, slots=True)
class RejectedView:
    """A picture of one camera that the rig's fit does not use, and the reason."""

    camera: str
    file: str
    reason: str


@dataclass(frozen=True, slots=True)
class FoundEffect:
    """An effect of the rig that its diagnosis found."""

    effect: str
    camera: str
    varies: str
    """`each_view`, `from_view`, or empty for a number that holds for all placements."""
    from_file: str
    """The first picture after a slip; empty for other effects."""
    parameters: Mapping[str, ParameterEstimate]
    sentence: str = ""
    """The finding in words, without a full stop."""

    def as_mapping(self) -> dict[str, object]:
        """Return the entry of rig_calibration.yaml and of `--json`."""
        return {
            "effect": self.effect,
            "camera": self.camera,
            "varies": self.varies or None,
            "from_file": self.from_file or None,
            "parameters": {
                name: {"value": number.value, "sigma": number.sigma, "unit": number.unit}
                for name, number in self.parameters.items()
            },
            "sentence": self.sentence,
        }

    @staticmethod
    def of_mapping(entry: Mapping[str, Any]) -> FoundEffect:
        """Return the effect of such an entry."""
        return FoundEffect(
            effect=str(entry["effect"]),
            camera=str(entry["camera"]),
            varies=str(entry["varies"] or ""),
            from_file=str(entry["from_file"] or ""),
            parameters={
                str(name): ParameterEstimate(
                    float(number["value"]), float(number["sigma"]), str(number["unit"])
                )
                for name, number in entry["parameters"].items()
            },
            sentence=str(entry["sentence"]),
        )


@dataclass(frozen=True, slots=True)
class RigRecord:
    """The record of a rig's fit."""

    source: str = ""
    """The path of the rig.yaml."""
    outcome: str = ""
    """A sentence of `calib.estimation.levenberg_marquardt.Outcome`."""
    iterations: int = 0
    """The number of linearisations."""
    scatter: float = 1.0
    """The scatter of the placements about the fit, over that of independent corners; the covariance
    is of placements that scatter so.
    """
    turned: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """For each camera, the views whose corners were renumbered, because the board looks turned
    there.
    """
    rejected: tuple[RejectedView, ...] = ()
    alone_px: Mapping[str, float] = field(default_factory=dict)
    """For each camera, the error of its views in the fit of this camera alone."""
    baseline: Number | None = None
    """m: the measured distance between the two cameras of a pair, a prior of the fit."""
    effects: tuple[FoundEffect, ...] = ()
    """The effects that a diagnosis added to the fit."""


@dataclass(frozen=True, slots=True)
class Mounting:
    """The pose of a camera in the rig."""

    T_camera_reference: Array
    """(4, 4)"""
    sigma: Array
    """(6,) standard deviations of a small rotation (rad) and translation (m) of the camera frame.
    The frames are those of the pinholes, whose directions the views determine less well than those
    of the rays.
    """
    ray_sigma: Array
    """(6,) the same for the rays of this camera against those of the reference, without the motion
    of either camera's rays against its own pinhole.
    """


@dataclass(frozen=True, slots=True)
class Baseline:
    """The distance between the pinholes of two cameras."""

    first: str
    second: str
    metres: float
    sigma: float
    """m"""

    def as_mapping(self) -> dict[str, object]:
        """Return the entry of rig_calibration.yaml and of `--json`."""
        metres = {"value": self.metres, "sigma": self.sigma}
        return {"from": self.first, "to": self.second, "metres": metres}


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RigContent:
    """Several calibrated cameras behind covers, and where they are mounted."""

    calibrations: Mapping[str, Calibration]
    """The calibration of each camera, in the order of rig.yaml. Their poses are those of the
    placements.
    """
    reference: str
    """The camera whose frame is that of the rig."""
    mountings: Array
    """(C, 6) T_camera_reference: rotation vectors (rad) and translations (m); zero for the
    reference.
    """
    covariance: Array
    """(S, S) covariance of the vector of `RigLayout`: all cameras' parameters and mountings,
    placements marginalised; (0, 0) if it could not be estimated.
    """
    placements: Array
    """(P, 6) T_reference_board."""
    placement_names: tuple[str, ...]
    """P names, each that of its first picture."""
    of_views: Mapping[str, Indices]
    """For each camera, the (V,) placement of each view of its calibration."""
    covers: Mapping[str, str] = field(default_factory=dict)
    """The first camera behind the same cover, by the name of each further camera behind it."""
    media: Mapping[str, str] = field(default_factory=dict)
    """The first camera in the same medium, by the name of each further one: their covers have one
    index outside. Cameras behind another camera's cover are not listed.
    """
    record: RigRecord = field(default_factory=RigRecord)
    refracal: str = VERSION
    """The version of Refracal that made it."""

    def __repr__(self) -> str:
        cameras = ", ".join(self.calibrations)
        return harmless(f"<Rig: {cameras}; {len(self.placements)} placements of the board>")

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the cameras."""
        return tuple(self.calibrations)

    @property
    def bends(self) -> Array:
        """(P, 12) m, the bend of the board in each placement in the terms of `board_flex`; (P, 0)
        for a board that has the same shape in all placements.
        """
        count = max(c.poses.shape[1] for c in self.calibrations.values()) - 6
        bends = np.zeros((len(self.placements), count))
        for name, places in self.of_views.items() if count else ():
            bends[places] = self.calibrations[name].poses[:, 6:]
        return bends

    @property
    def placement_numbers(self) -> Array:
        """(P, 6) the placements, or (P, 18) with the bends of the board."""
        return np.concatenate([self.placements, self.bends], 1)

    @property
    def cameras_seeing(self) -> Indices:
        """(P,) the number of cameras that see each placement."""
        seeing = np.zeros(len(self.placements), np.int64)
        for places in self.of_views.values():
            seeing[np.unique(places)] += 1
        return seeing

    def index(self, name: str) -> int:
        """Return the place of a camera among the names.

        Raises:
            InputError: the rig has no camera of this name.
        """
        if name not in self.calibrations:
            raise InputError(
                f"The rig has no camera {brief(repr(name))}: its cameras are"
                f" {', '.join(self.calibrations)}."
            )
        return self.names.index(name)
