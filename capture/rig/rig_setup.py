"""The set-up of a rig's recording."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from calib.errors import InputError
from calib.session.board import Board
from capture.rig.rig_folder import RigFolder
from capture.rig.rig_sources import NAMED, read_names
from capture.session_file import Setup, read_setup


@dataclass(frozen=True, slots=True)
class RigSetup:
    rig: RigFolder
    sources: tuple[str, ...]
    """The text of each camera's source, NAME=SOURCE."""
    board: Board
    likes: Mapping[str, Setup]
    """Board, camera and cover for cameras whose session has no session.yaml yet."""


def read_likes(texts: Sequence[str], cameras: Sequence[str]) -> dict[str, Setup]:
    """Return the setups that `--cover-from` gives to cameras: FILE for all of them, or NAME=FILE
    for each.
    """
    if len(texts) == 1 and not NAMED.fullmatch(texts[0]):
        return dict.fromkeys(cameras, read_setup(Path(texts[0])))
    files = read_names(texts, "--cover-from")
    for name in files:
        if name not in cameras:
            raise InputError(
                f"--cover-from names {name}, which is no camera: the cameras are"
                f" {', '.join(cameras)}."
            )
    return {name: read_setup(Path(file)) for name, file in files.items()}
