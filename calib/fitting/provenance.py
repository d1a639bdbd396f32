"""What a calibration was made from and with: kept in its settings, printed in its report."""

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
"""Of a calibration's settings: what the command line asked for beyond the fit's own."""
DIAGNOSED = "diagnosed"
"""Of a calibration's settings: what was diagnosed on the way to it, the first first."""
PACKAGES = ("numpy", "scipy", "torch", "opencv-python-headless")


def provenance(session: Session) -> dict[str, str]:
    """Which session a fit that ends now was made from, and with which versions."""
    return {
        "session": str(session.path.resolve()),
        "session_sha256": session_hash(session),
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "python": platform.python_version(),
        "machine": f"{platform.system()} {platform.machine()}",
        **{name: _version(name) for name in PACKAGES},
    }


def asked(calibration: Calibration, effects: Sequence[str], depths: Sequence[float]) -> Calibration:
    """The calibration that keeps what `calib fit` was asked to add to it, and which maps (m) to
    write.
    """
    return replace(
        calibration,
        settings=calibration.settings | {ASKED: {"effects": list(effects), "depths": list(depths)}},
    )


def diagnosed(calibration: Calibration, place: Path, holdout: Path | None) -> Calibration:
    """The calibration that keeps the folder of the one that it was diagnosed from, and the session
    that measured it.
    """
    said = {
        "calibration": str(place.resolve()),
        "holdout": str(holdout.resolve()) if holdout else "",
    }
    return replace(
        calibration,
        settings=calibration.settings
        | {DIAGNOSED: [*calibration.settings.get(DIAGNOSED, []), said]},
    )


def session_hash(session: Session) -> str:
    """SHA-256 of what `sha256sum` prints, run inside the session, for the files that a fit reads,
    sorted by their names.
    """
    files = sorted(_read(session), key=str)
    with reading(session.path), ThreadPoolExecutor() as pool:
        digests = pool.map(lambda path: sha256(read_file(path)).hexdigest(), files)
        lines = [
            f"{digest}  {path.relative_to(session.path)}\n"
            for digest, path in zip(digests, files, strict=True)
        ]
    return sha256("".join(lines).encode()).hexdigest()


def _read(session: Session) -> list[Path]:
    description = [path] if (path := session.path / "session.yaml").exists() else []
    pictures = [session.corners] if session.corners else session.frames
    return [*description, *pictures, *(_read(session.bare) if session.bare else [])]


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:  # OpenCV comes under several names
        return "unknown"
