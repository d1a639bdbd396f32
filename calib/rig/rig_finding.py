"""The result of the diagnosis of a rig, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from calib.diagnosis.finding import ParameterEstimate
from calib.fit_record.history import Family
from calib.rig.rig_content import FoundEffect


@dataclass(frozen=True, slots=True)
class RigCandidate:
    """An explanation that was considered, in the round in which it came closest to acceptance."""

    effect: str
    camera: str
    """The camera that it is about. Of a pair, the other one may be it instead."""
    varies: str | None
    from_file: str | None
    """The first picture after a slip."""
    log_odds: float
    """The logarithm of its probability over that of no cause."""
    parameters: Mapping[str, ParameterEstimate]
    held_out_px_before: float | None
    """The error on held-out placements without it; None if the odds were too low to hold out."""
    held_out_px_after: float | None
    gain_ci95: tuple[float, float] | None
    """px"""
    p_value: float | None
    """The probability of such a gain by chance."""
    accepted: bool
    verdict: str


@dataclass(frozen=True, slots=True)
class RigQuality:
    """The error of a rig, px."""

    rms_px: float
    held_out_px: float


@dataclass(frozen=True, slots=True)
class RigDiagnosis:
    """The result of the diagnosis of a rig."""

    candidates: tuple[RigCandidate, ...]
    """The most probable first."""
    found: tuple[FoundEffect, ...]
    """The accepted effects, in the order in which they were found."""
    families: tuple[Family, ...]
    """For accepted effects that these placements do not tell from others."""
    before: RigQuality
    after: RigQuality
    placements: int
    """The placements that two cameras saw."""
    bursts: int
    speed_m_s: float | None
    """The root mean square speed of the board in bursts; None without bursts."""
    remarks: tuple[str, ...] = field(default_factory=tuple)
    """Sentences on what the placements leave open."""

    @property
    def accepted(self) -> tuple[str, ...]:
        return tuple(effect.effect for effect in self.found)

    def as_json(self) -> dict[str, object]:
        """Return the JSON object of the command contract."""
        return {
            "candidates": [asdict(candidate) for candidate in self.candidates],
            "accepted": list(self.accepted),
            "effects": [effect.as_mapping() for effect in self.found],
            "families": [asdict(family) for family in self.families],
            "before": asdict(self.before),
            "after": asdict(self.after),
            "shared_placements": self.placements,
            "bursts": self.bursts,
            "speed_m_s": self.speed_m_s,
            "remarks": list(self.remarks),
        }
