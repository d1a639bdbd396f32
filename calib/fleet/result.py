"""The result of one camera: a JSON next to its folder, written completely or not at all."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

from calib.fleet.identity import FORMAT, Identity
from calib.fleet.numbers import FleetNumber, PriorShift, numbers_as_json, shifts_as_json
from calib.io.files import make_folder, read_file
from calib.io.json_text import json_text
from calib.io.output_folder import BESIDE, OutputFolder
from calib.version import VERSION

PAGES = ("fleet.html", "fleet.csv")
CAMERAS = "cameras"
"""The folder in a fleet's folder that holds one folder and one JSON for each camera."""


class JobState(Enum):
    """The outcome of a camera."""

    CALIBRATED = "calibrated"
    TOO_LITTLE = "too_little_data"
    """The session has too little data; the same session would fail again."""
    FAILED = "failed"
    """A file cannot be read or written, or calib has a bug. The next run tries it again."""


@dataclass(frozen=True, slots=True)
class Result:
    """The result of one camera."""

    id: str
    state: JobState
    sentence: str = ""
    """The reason why there is no calibration; empty with one."""
    identity: Identity | None = None
    verdict: Mapping[str, Any] = field(default_factory=dict)
    """The last calibration's verdict, as `Verdict.as_json`."""
    numbers: Mapping[str, FleetNumber] = field(default_factory=dict)
    effects: tuple[str, ...] = ()
    """The effects that the diagnosis found."""
    check: Mapping[str, Any] = field(default_factory=dict)
    """The check against the prior, as `CheckResult.as_json`; empty without a prior."""
    shifts: Mapping[str, PriorShift] = field(default_factory=dict)
    """The shift of each number from the prior's."""
    remarks: tuple[str, ...] = ()
    """Sentences about further steps that failed: the check, the diagnosis, the export."""
    written: tuple[str, ...] = ()
    """Paths relative to the fleet's folder."""
    views: int = 0
    recorded: str = ""
    """The day of the first picture; empty if frames.csv does not say it."""
    seconds: float = 0.0

    @property
    def report(self) -> str:
        """Return the path of the last report; empty without one."""
        return next((path for path in reversed(self.written) if path.endswith("report.html")), "")

    def finished(self, identity: Identity, fleet: Path) -> bool:
        """Return True if the result is complete and belongs to the same session and settings."""
        same = (
            self.state is not JobState.FAILED
            and self.identity is not None
            and self.identity.same(identity)
        )
        return same and all((fleet / path).exists() for path in self.written)

    def write(self, fleet: Path, *, overwrite: bool = False) -> None:
        """Write the result beside the camera's folder; InputError if it cannot be written, or if
        another file has its name.
        """
        document = {
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
            "numbers": numbers_as_json(self.numbers),
            "effects": self.effects,
            "check": self.check,
            "moved": shifts_as_json(self.shifts),
            "remarks": self.remarks,
            "written": self.written,
            "views": self.views,
            "recorded": self.recorded,
            "seconds": self.seconds,
        }
        folder = fleet / CAMERAS / self.id
        make_folder(folder)
        output = OutputFolder(folder, overwrite=overwrite)
        output.write(result_name(self.id), json_text(document) + "\n")


def fleet_files(fleet: Path) -> list[Path]:
    """Return the files of a batch in its folder, which no output may replace."""
    pages = [fleet / page for page in PAGES]
    return [*pages, *(path for path in (fleet / CAMERAS).rglob("*") if path.is_file())]


def result_name(camera: str) -> str:
    """Return the name of a camera's JSON in the list of its folder."""
    return f"{BESIDE}{camera}.json"


def place_of(fleet: Path, camera: str) -> Path:
    return fleet / CAMERAS / f"{camera}.json"


def read_result(fleet: Path, camera: str) -> Result | None:
    """Return a camera's result; None if there is none, or if its file is incomplete."""
    path = place_of(fleet, camera)
    if not path.exists():
        return None
    try:
        document = json.loads(read_file(path))
        if document["format"] != FORMAT:
            return None
        return Result(
            id=document["id"],
            state=JobState(document["state"]),
            sentence=document["sentence"],
            identity=Identity.read(document["identity"]),
            verdict=document["verdict"],
            numbers={
                name: FleetNumber(float(number["value"]), float(number["sigma"]), number["unit"])
                for name, number in document["numbers"].items()
            },
            effects=tuple(document["effects"]),
            check=document["check"],
            shifts={
                name: PriorShift(
                    prior=float(shift["before"]),
                    current=float(shift["after"]),
                    sigmas=_number(shift["sigmas"]),
                    unit=shift["unit"],
                )
                for name, shift in document["moved"].items()
            },
            remarks=tuple(document["remarks"]),
            written=tuple(map(str, document["written"])),
            views=int(document["views"]),
            recorded=str(document["recorded"]),
            seconds=float(document["seconds"]),
        )
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
        return None


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)
