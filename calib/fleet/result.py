"""What became of one camera: a JSON beside its folder, written whole or not at all."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

from calib.fleet.identity import FORMAT, Identity
from calib.fleet.numbers import Measured, Moved, as_json
from calib.io.files import make_folder, read_file
from calib.io.json_text import json_text
from calib.io.output_folder import BESIDE, OutputFolder
from calib.version import VERSION

PAGES = ("fleet.html", "fleet.csv")
CAMERAS = "cameras"
"""The folder in a fleet's folder that holds one folder and one JSON for each camera."""


class State(Enum):
    """How a camera ended."""

    CALIBRATED = "calibrated"
    TOO_LITTLE = "too_little_data"
    """The same session gives no calibration another time either."""
    FAILED = "failed"
    """Something cannot be read or written, or a bug: it is tried again by the next run."""


@dataclass(frozen=True, slots=True)
class Result:
    """Of a camera."""

    id: str
    state: State
    sentence: str = ""
    """Why there is no calibration."""
    identity: Identity | None = None
    verdict: Mapping[str, Any] = field(default_factory=dict)
    """Of the last calibration, as `Verdict.as_json`."""
    numbers: Mapping[str, Measured] = field(default_factory=dict)
    effects: tuple[str, ...] = ()
    """What its diagnosis found."""
    check: Mapping[str, Any] = field(default_factory=dict)
    """Against its prior, as `CheckResult.as_json`; empty without a prior."""
    moved: Mapping[str, Moved] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()
    """What could not be done beside the calibration."""
    written: tuple[str, ...] = ()
    """Paths in the fleet's folder."""
    views: int = 0
    recorded: str = ""
    """The day of its first picture, where frames.csv says it."""
    seconds: float = 0.0

    @property
    def report(self) -> str:
        """Its last report's path; empty without one."""
        return next((path for path in reversed(self.written) if path.endswith("report.html")), "")

    def finished(self, identity: Identity, fleet: Path) -> bool:
        """Whether it need not be done again."""
        same = (
            self.state is not State.FAILED
            and self.identity is not None
            and self.identity.same(identity)
        )
        return same and all((fleet / path).exists() for path in self.written)

    def write(self, fleet: Path, *, overwrite: bool = False) -> None:
        """Write the result beside the camera's folder; InputError where it cannot be, or where
        another file has its name.
        """
        said = {
            "format": FORMAT,
            "refracal": VERSION,
            "id": self.id,
            "state": self.state.value,
            "sentence": self.sentence,
            "identity": (
                {name: getattr(self.identity, name) for name in ("settings", "listing", "contents")}
                if self.identity
                else None
            ),
            "verdict": self.verdict,
            "numbers": as_json(self.numbers),
            "effects": self.effects,
            "check": self.check,
            "moved": as_json(self.moved),
            "remarks": self.remarks,
            "written": self.written,
            "views": self.views,
            "recorded": self.recorded,
            "seconds": self.seconds,
        }
        folder = fleet / CAMERAS / self.id
        make_folder(folder)
        output = OutputFolder(folder, overwrite=overwrite)
        output.write(result_name(self.id), json_text(said) + "\n")


def fleet_files(fleet: Path) -> list[Path]:
    """Return the files of a batch in its folder, which no output may replace."""
    pages = [fleet / page for page in PAGES]
    return [*pages, *(path for path in (fleet / CAMERAS).rglob("*") if path.is_file())]


def result_name(camera: str) -> str:
    """Return the name of a camera's JSON, as the list in the camera's folder has it."""
    return f"{BESIDE}{camera}.json"


def place_of(fleet: Path, camera: str) -> Path:
    return fleet / CAMERAS / f"{camera}.json"


def read_result(fleet: Path, camera: str) -> Result | None:
    """None where there is none, or what is there is not whole."""
    place = place_of(fleet, camera)
    if not place.exists():
        return None
    try:
        said = json.loads(read_file(place))
        if said["format"] != FORMAT:
            return None
        return Result(
            id=said["id"],
            state=State(said["state"]),
            sentence=said["sentence"],
            identity=Identity.read(said["identity"]),
            verdict=said["verdict"],
            numbers={
                name: Measured(float(one["value"]), float(one["sigma"]), one["unit"])
                for name, one in said["numbers"].items()
            },
            effects=tuple(said["effects"]),
            check=said["check"],
            moved={
                name: Moved(
                    float(one["before"]), float(one["after"]), _number(one["sigmas"]), one["unit"]
                )
                for name, one in said["moved"].items()
            },
            remarks=tuple(said["remarks"]),
            written=tuple(map(str, said["written"])),
            views=int(said["views"]),
            recorded=str(said["recorded"]),
            seconds=float(said["seconds"]),
        )
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
