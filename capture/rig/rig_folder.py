"""The folder of a rig: its rig.yaml, read or made, and the sessions of its cameras."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from calib.errors import InputError
from calib.io.files import reading
from calib.io.images import list_images
from calib.io.shell import shell_line
from calib.io.yaml_reader import read_yaml
from calib.rig.rig_file import BY_NAME, FORMAT, NAME
from calib.session.board import Board
from calib.session.schema import Section
from capture.disk import write_durably, writing
from capture.session_file import BOARD_ADVICE, Setup, board_of, picture_folder


@dataclass(frozen=True, slots=True)
class RigFolder:
    """The places that a recording of a rig writes to."""

    path: Path
    sessions: Mapping[str, Path]
    """The session folder of each camera."""

    @property
    def file(self) -> Path:
        return self.path / NAME

    @property
    def fit_command(self) -> str:
        """The command that comes after the recording."""
        return shell_line("calib", "rig", "fit", self.path, "-o", self.path / "calibration")

    @staticmethod
    def of(path: Path, cameras: Sequence[str]) -> "RigFolder":
        """Return the folder of a rig with these cameras, as its rig.yaml describes it if it has
        one; else each camera has a folder of its name.

        Raises:
            InputError: rig.yaml has other cameras, or pictures are there and no rig.yaml.
        """
        file = path / NAME
        with reading(file):
            if path.exists() and not path.is_dir():
                raise InputError(
                    f"{path} is not a folder: name the rig's folder, which is made if need be."
                )
            described = file.exists()
        if described:
            return RigFolder(path, _read_sessions(file, cameras))
        rig = RigFolder(path, {name: path / name for name in cameras})
        for name, session in rig.sessions.items():
            pictures = picture_folder(session, bare=False)
            with reading(pictures):
                if pictures.is_dir() and list_images(pictures):
                    raise InputError(
                        f"{pictures} has pictures, and no {file} says which pictures of the other"
                        f" cameras belong to them: write {NAME}, or record {name} elsewhere."
                    )
        return rig

    def board(self, requested: Board | None, likes: Mapping[str, Setup]) -> Board:
        """Return the one board of all cameras: that of the sessions that are described, or the
        requested one.

        Raises:
            InputError: there is none, or the sessions have different ones.
        """
        described = [
            name for name, session in self.sessions.items() if (session / "session.yaml").exists()
        ]
        board = requested
        for name in described:
            board = board_of(self.sessions[name], board, likes.get(name))
        if board is None:
            raise InputError(f"{self.path} describes no board yet: {BOARD_ADVICE}")
        return board

    def describe(self) -> bool:
        """Write rig.yaml where there is none, and return True if it was written."""
        if self.file.exists():
            return False
        places = {name: session.name for name, session in self.sessions.items()}
        content = {
            "format": FORMAT,
            "cameras": places,
            "reference": next(iter(places)),
            "together": BY_NAME,
        }
        with writing(self.path):
            self.path.mkdir(parents=True, exist_ok=True)
        write_durably(self.file, yaml.safe_dump(content, sort_keys=False, allow_unicode=True))
        return True


def _read_sessions(file: Path, cameras: Sequence[str]) -> dict[str, Path]:
    """Return the session folder of each camera, whose folder may have no pictures yet."""
    section = Section(read_yaml(file), str(file))
    section.choice("format", (FORMAT,), f"{FORMAT}, the format that this version reads")
    described = section.section("cameras", "{left: left, right: right}")
    names = tuple(described.values)
    if set(names) != set(cameras):
        raise InputError(
            f"{file} has the cameras {', '.join(names)} where --source names {', '.join(cameras)}:"
            " name the same ones, or record another rig."
        )
    return {
        name: file.parent / described.text(name, f"the folder of {name}'s session, from {file} on")
        for name in names
    }
