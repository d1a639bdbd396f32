"""What a calibration was made from and with: kept in its settings, printed in its report."""

import platform
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from calib.io.files import reading
from calib.session.session import Session

KEY = "made_by"
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


def session_hash(session: Session) -> str:
    """SHA-256 of what `sha256sum` prints, run inside the session, for the files that a fit reads, sorted by their names."""
    files = sorted(_read(session), key=str)
    with reading(session.path), ThreadPoolExecutor() as pool:
        digests = pool.map(lambda path: sha256(path.read_bytes()).hexdigest(), files)
        lines = [f"{digest}  {path.relative_to(session.path)}\n" for digest, path in zip(digests, files, strict=True)]
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
