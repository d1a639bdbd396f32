"""The origin of a session's pictures, which says how to take more of them."""

import re
from enum import Enum
from pathlib import Path

from calib.io.images import frames_folder
from calib.io.output_folder import LEDGER
from calib.io.videos import VIDEOS, list_videos

IMPORTED = re.compile("# Imported by calib import from (.*)[.]")
"""The first line of a session.yaml that `calib import` wrote."""


class PictureSource(Enum):
    """The origin of a session's pictures."""

    CAPTURE = "capture"
    """`capture` recorded them, or may record the like."""
    DEVICE = "device"
    """A person put pictures of another device there, or another program did."""
    FILM = "film"
    """`calib fit` or `calib import` took them from a video."""


def picture_source(session: Path) -> PictureSource:
    """Return where the pictures of a session come from. A session that is not here counts as one of
    capture.
    """
    if frames_folder(session) == session:
        return PictureSource.DEVICE
    if name := _imported_from(session / "session.yaml"):
        is_film = Path(name).suffix.lower() in VIDEOS
        return PictureSource.FILM if is_film else PictureSource.DEVICE
    if not (session / "frames" / LEDGER).exists():
        return PictureSource.CAPTURE
    return PictureSource.FILM if _is_beside_video(session) else PictureSource.DEVICE


def _is_beside_video(session: Path) -> bool:
    """Return True if a video of the session's name is beside it; False if that cannot be read."""
    try:
        return any(video.stem == session.name for video in list_videos(session.absolute().parent))
    except OSError:
        return False


def _imported_from(file: Path) -> str:
    """Return the name of what a session was imported from; empty if it was not."""
    try:
        with file.open(encoding="utf-8", errors="replace") as lines:
            match = IMPORTED.match(lines.readline(1000))
    except OSError:
        return ""
    return match[1] if match else ""
