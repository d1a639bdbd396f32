"""The differences between a session's pictures that one calibration cannot have: two cameras, two
zooms, a focus that moved.
"""

from collections.abc import Sequence
from pathlib import Path

from calib.io.camera_names import describe_cameras, find_cameras
from calib.io.exif import camera_settings, describe_differences
from calib.io.files import read_file
from calib.io.frames_table import NAME as FRAMES_TABLE
from calib.io.frames_table import read_table
from calib.session.session import Session

RECORDED = {"lens_position": "lens position", "focal_length": "focal length", "focus": "focus"}
"""The columns of frames.csv that say where the lens was, and their words."""
DIGITS = 3
"""Digits to which a recorded position is compared: cameras round the requested values."""


def describe_mixed_settings(session: Session, pictures: Sequence[str]) -> tuple[str, ...]:
    """Return a sentence for each difference of these pictures, by their names, their EXIF and
    frames.csv.
    """
    names = [Path(picture).name for picture in pictures]
    sentences: list[str] = []
    if cameras := find_cameras(names):
        sentences.append(f"{describe_cameras(cameras)}: keep those of one in the session.")
    used = set(names)
    settings: dict[str, dict[str, str]] = {}
    if not session.corners:
        for path in session.frames:
            if path.name in used:
                settings[path.name] = camera_settings(read_file(path))
    for row in read_table(session.path / FRAMES_TABLE):
        name = Path(row["file"]).name
        if name in used:
            stated = settings.setdefault(name, {})
            for column, word in RECORDED.items():
                if text := row.get(column, "").strip():
                    stated[word] = _rounded(text)
    return (*sentences, *describe_differences(settings))


def _rounded(text: str) -> str:
    try:
        return f"{float(text):.{DIGITS}g}"
    except ValueError:
        return text
