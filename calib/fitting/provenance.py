"""The provenance of a calibration: its inputs and versions, kept in its settings and printed in its
report.
"""

import platform
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from datetime import UTC, datetime
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from calib.calibration import Calibration
from calib.io.files import read_file, reading
from calib.session.session import Session

KEY = "made_by"
ASKED = "asked"
"""Key of a calibration's settings: the options of the command line that are not the fit's own."""
DIAGNOSED = "diagnosed"
"""Key of a calibration's settings: the calibrations whose diagnoses led to it, earliest first."""
PACKAGES = ("numpy", "scipy", "torch", "opencv-python-headless")


def provenance(session: Session) -> dict[str, str]:
    """Return the session of a fit that ends now, the time, and the versions that made it."""
    return {
        "session": str(session.path.resolve()),
        "session_sha256": session_hash(session),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        **{name: _version(name) for name in PACKAGES},
    }


def record_request(
    calibration: Calibration, effects: Sequence[str], depths: Sequence[float]
) -> Calibration:
    """Return the calibration with a record of the effects that `calib fit` was asked to add, and of
    the depths (m) whose maps it was asked to write.
    """
    return replace(
        calibration,
        settings=calibration.settings | {ASKED: {"effects": list(effects), "depths": list(depths)}},
    )


def record_diagnosis(calibration: Calibration, place: Path, holdout: Path | None) -> Calibration:
    """Return the calibration with a record of its diagnosis: the folder of the diagnosed
    calibration and the session of the held-out views.
    """
    diagnosis = {
        "calibration": str(place.resolve()),
        "holdout": str(holdout.resolve()) if holdout else "",
    }
    return replace(
        calibration,
        settings=calibration.settings
        | {DIAGNOSED: [*calibration.settings.get(DIAGNOSED, []), diagnosis]},
    )


def session_hash(session: Session) -> str:
    """Return the SHA-256 of the text that `sha256sum` prints inside the session's folder for the
    files that a fit reads, sorted by their names.
    """
    files = sorted(_input_files(session), key=str)
    with reading(session.path), ThreadPoolExecutor() as pool:
        digests = pool.map(lambda path: sha256(read_file(path)).hexdigest(), files)
        lines = [
            f"{digest}  {path.relative_to(session.path)}\n"
            for digest, path in zip(digests, files, strict=True)
        ]
    return sha256("".join(lines).encode()).hexdigest()


def _input_files(session: Session) -> list[Path]:
    description = [path] if (path := session.path / "session.yaml").exists() else []
    pictures = [session.corners] if session.corners else session.frames
    return [*description, *pictures, *(_input_files(session.bare) if session.bare else [])]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # OpenCV comes under several names
        return "unknown"
