"""Recordings of ROS, by their names."""

from pathlib import Path

from calib.errors import InputError
from calib.io.files import reading

SUFFIXES = (".bag", ".mcap", ".db3")


def is_bag(path: Path) -> bool:
    """Return True if the path is a recording of ROS by its name, or by its metadata.yaml."""
    with reading(path):
        return path.suffix.lower() in SUFFIXES or (path / "metadata.yaml").is_file()


def refuse_bag(path: Path) -> None:
    """Raise InputError if a path that is read as pictures or a video is a recording by its name."""
    if path.suffix.lower() in SUFFIXES:
        raise InputError(
            f"{path} is a recording of ROS: `calib import bag` makes a session of its pictures, and"
            " `calib undistort` makes them straight."
        )
