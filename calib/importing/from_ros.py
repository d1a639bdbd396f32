"""Import from ROS: the calibrationdata.tar.gz that camera_calibration's Save button writes.

The archive of one camera has left-0000.png ... and ost.yaml. That of a stereo pair has
left-0000.png ..., right-0000.png ..., left.yaml and right.yaml. Nothing in it states which board
was used.
"""

import gzip
import re
import tarfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, cast

from calib.errors import InputError, brief
from calib.importing.session_draft import SessionDraft
from calib.io.files import check_regular, reading
from calib.io.yaml_reader import read_yaml
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.schema import Section

GZIP = b"\x1f\x8b"
PICTURE = re.compile(r"(left|right)-[0-9]+\.png")
MAX_SETTINGS_BYTES = 1 << 20
"""A larger file is no settings file."""
MAX_PICTURE_BYTES = 1 << 28
"""A sparse file of the archive may claim any size."""


class _Bounded:
    """A file that refuses to be read in pieces larger than a picture: tarfile reads a member's
    extended header in one piece, of whatever length the archive states.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.seek = file.seek
        self.tell = file.tell

    def read(self, size: int) -> bytes:
        if size > MAX_PICTURE_BYTES + tarfile.BLOCKSIZE:
            raise tarfile.ReadError("a header that is too large")
        return self._file.read(size)


def from_ros_archive(path: Path, board: Board, camera: str | None) -> SessionDraft:
    """Import one camera's pictures; `camera`, left or right, chooses one of a stereo pair."""
    with _open_archive(path) as tar:
        members = {Path(member.name).name: member for member in _members(path, tar)}
        sides = {name: match[1] for name in members if (match := PICTURE.fullmatch(name))}
        pair = len(set(sides.values())) == 2
        if pair and camera is None:
            raise InputError(
                f"{path} holds the pictures of two cameras: choose one with --camera left or"
                " --camera right."
            )
        side = camera or "left"
        pictures = frozenset(name for name in sides if sides[name] == side)
        settings = f"{side}.yaml" if pair else "ost.yaml"
        if not pictures or settings not in members:
            raise InputError(
                f"{path} lacks {settings if pictures else f'{side}-*.png'}: give the"
                " calibrationdata.tar.gz that ROS's camera_calibration saved, or unpack it and use"
                " calib import images."
            )
        if members[settings].size > MAX_SETTINGS_BYTES:
            raise InputError(
                f"{path}: {settings} is too large to be a camera's settings: give the archive that"
                " ROS saved."
            )
        camera_settings = _camera(path, settings, _read(tar, members[settings]))
    return SessionDraft(path, board, camera_settings, frames=_pictures(path, pictures))


def _camera(path: Path, name: str, data: bytes) -> Camera:
    with TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(data)
        try:
            settings = Section(read_yaml(file), f"{path}, {name}")
        except InputError as error:
            raise InputError(str(error).replace(str(file), f"{path}, {name}")) from error
    width = settings.integer("image_width", 1, 100_000)
    height = settings.integer("image_height", 1, 100_000)
    return Camera(width, height, settings.text("camera_name", "the camera's name", default=""))


def _pictures(path: Path, names: frozenset[str]) -> Iterator[tuple[str, bytes]]:
    with _open_archive(path) as tar:
        for member in _members(path, tar):
            name = Path(member.name).name
            if name in names:
                yield name, _read(tar, member)


@contextmanager
def _open_archive(path: Path) -> Iterator[tarfile.TarFile]:
    """Open the archive. That it is damaged, or no archive, may show only while it is read."""
    check_regular(path)
    with reading(path), path.open("rb") as file:
        packed = file.read(len(GZIP)) == GZIP
        file.seek(0)
        try:
            with gzip.GzipFile(fileobj=file) if packed else nullcontext(file) as unpacked:
                bounded = cast(IO[bytes], _Bounded(cast(IO[bytes], unpacked)))
                with tarfile.open(fileobj=bounded, mode="r:") as tar:
                    yield tar
        except (tarfile.TarError, EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise InputError(
                f"{path} is not a tar archive, or a damaged one: give the calibrationdata.tar.gz"
                " that ROS saved."
            ) from error


def _members(path: Path, tar: tarfile.TarFile) -> Iterator[tarfile.TarInfo]:
    """Yield the archive's files."""
    for member in tar:
        if member.isfile():
            if member.size > MAX_PICTURE_BYTES:
                raise InputError(
                    f"{path}: {brief(member.name)} in it is larger than the"
                    f" {MAX_PICTURE_BYTES >> 20} MB that a picture may have: give the"
                    " calibrationdata.tar.gz that ROS saved."
                )
            yield member


def _read(tar: tarfile.TarFile, member: tarfile.TarInfo) -> bytes:
    file = tar.extractfile(member)
    assert file
    return file.read()
