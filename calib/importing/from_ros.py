"""ROS: the calibrationdata.tar.gz that camera_calibration's Save button writes.

One camera: left-0000.png ... and ost.yaml. A stereo pair: left-0000.png ..., right-0000.png ...,
    left.yaml and right.yaml. Nothing in it
says which board was used.
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
from calib.importing.session_draft import Draft
from calib.io.files import check_regular, reading
from calib.io.yaml_reader import read_yaml
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.schema import Section

GZIP = b"\x1f\x8b"
PICTURE = re.compile(r"(left|right)-[0-9]+\.png")
LARGEST = 1 << 20
"""bytes of a settings file: a larger one is something else."""
LARGEST_PICTURE = 1 << 28
"""bytes. A sparse file of the archive says any size."""


class _Bounded:
    """A file that refuses to be read in pieces larger than a picture: tarfile reads a member's
    extended header in one piece, of whatever length the archive states.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self.seek = file.seek
        self.tell = file.tell

    def read(self, size: int) -> bytes:
        if size > LARGEST_PICTURE + tarfile.BLOCKSIZE:
            raise tarfile.ReadError("a header that is too large")
        return self._file.read(size)


def from_tar(path: Path, board: Board, camera: str | None) -> Draft:
    """One camera's pictures; which one of a stereo pair, `camera` says: left or right."""
    with _opened(path) as tar:
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
        if members[settings].size > LARGEST:
            raise InputError(
                f"{path}: {settings} is too large to be a camera's settings: give the archive that"
                " ROS saved."
            )
        described = _camera(path, settings, _read(tar, members[settings]))
    return Draft(path, board, described, frames=_pictures(path, pictures))


def _camera(path: Path, name: str, data: bytes) -> Camera:
    with TemporaryDirectory() as folder:
        file = Path(folder) / name
        file.write_bytes(data)
        try:
            said = Section(read_yaml(file), f"{path}, {name}")
        except InputError as error:
            raise InputError(str(error).replace(str(file), f"{path}, {name}")) from error
    width, height = (said.whole(key, 1, 100_000) for key in ("image_width", "image_height"))
    return Camera(width, height, said.text("camera_name", "the camera's name", default=""))


def _pictures(path: Path, names: frozenset[str]) -> Iterator[tuple[str, bytes]]:
    with _opened(path) as tar:
        for member in _members(path, tar):
            name = Path(member.name).name
            if name in names:
                yield name, _read(tar, member)


@contextmanager
def _opened(path: Path) -> Iterator[tarfile.TarFile]:
    """The archive; that it is none, or is damaged, may show only while it is read."""
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
    """Its files."""
    for member in tar:
        if member.isfile():
            if member.size > LARGEST_PICTURE:
                said = (
                    f"{brief(member.name)} in it is larger than the {LARGEST_PICTURE >> 20} MB that"
                    " a picture may have"
                )
                raise InputError(f"{path}: {said}: give the calibrationdata.tar.gz that ROS saved.")
            yield member


def _read(tar: tarfile.TarFile, member: tarfile.TarInfo) -> bytes:
    file = tar.extractfile(member)
    assert file
    return file.read()
