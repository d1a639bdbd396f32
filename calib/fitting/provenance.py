"""The provenance of a calibration: its inputs, and the versions of the programs that made it."""

import platform
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from calib.calibration import Calibration
from calib.errors import InputError
from calib.fit_record.history import DiagnosisRun
from calib.fit_record.request import CommandOptions, Provenance
from calib.io.files import read_file, reading
from calib.session.session import Session

PACKAGES = ("numpy", "scipy", "torch", "opencv-python-headless")


def provenance(session: Session | None) -> Provenance:
    """Return the session of a fit that ends now, the time, and the versions that made it. A fit to
    arrays has no session.
    """
    return Provenance(
        session=str(session.path.resolve()) if session else None,
        session_sha256=session_hash(session) if session else None,
        finished=datetime.now(UTC).isoformat(timespec="seconds"),
        python=platform.python_version(),
        machine=f"{platform.system()} {platform.machine()}",
        packages={name: _version(name) for name in PACKAGES},
    )


def record_request(
    calibration: Calibration, effects: Sequence[str], depths: Sequence[float]
) -> Calibration:
    """Return the calibration with a record of the effects that `calib fit` was asked to add, and of
    the depths (m) whose maps it was asked to write.
    """
    command = CommandOptions(tuple(effects), tuple(depths))
    return replace(calibration, request=replace(calibration.request, command=command))


def record_diagnosis(calibration: Calibration, place: Path, holdout: Path | None) -> Calibration:
    """Return the calibration with a record of its diagnosis: the folder of the diagnosed
    calibration and the session of the held-out views.
    """
    run = DiagnosisRun(str(place.resolve()), str(holdout.resolve()) if holdout else "")
    history = calibration.history
    runs = (*history.diagnosis_runs, run)
    return replace(calibration, history=replace(history, diagnosis_runs=runs))


def session_hash(session: Session) -> str:
    """Return the SHA-256 of the text that `sha256sum` prints inside the session's folder for the
    files that a fit reads, sorted by their names. It prints nothing for one that cannot be read.
    """
    files = sorted(_input_files(session), key=str)
    with reading(session.path), ThreadPoolExecutor() as pool:
        digests = pool.map(_digest, files)
        lines = [
            f"{digest}  {path.relative_to(session.path)}\n"
            for digest, path in zip(digests, files, strict=True)
            if digest
        ]
    return sha256("".join(lines).encode(errors="surrogateescape")).hexdigest()


def _digest(path: Path) -> str:
    """Return the SHA-256 of a file; empty if it cannot be read."""
    try:
        return sha256(read_file(path)).hexdigest()
    except InputError:
        return ""


def _input_files(session: Session) -> list[Path]:
    description = [path] if (path := session.path / "session.yaml").exists() else []
    pictures = [session.corners] if session.corners else [*session.frames, *session.point_files]
    return [*description, *pictures, *(_input_files(session.bare) if session.bare else [])]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # OpenCV comes under several names
        return "unknown"
