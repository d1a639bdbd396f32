"""The session that a screen's poses are written into. A pose is written under a temporary name,
forced to the disk and renamed: whatever is killed, the folder stays a session of whole poses.
"""

import io
import os
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Self

import numpy as np
import yaml
from numpy.typing import NDArray

from calib.errors import InputError
from calib.fringes.decode import ScreenPoints
from calib.io.arrays import decode_npz
from calib.io.files import read_file, reading
from calib.io.yaml_reader import read_yaml
from calib.session.camera import Camera
from calib.session.cover import Cover
from calib.session.point_target import PointTarget
from calib.session.points_file import FOLDER
from calib.session.schema import Number
from calib.session.session import FORMAT, TARGET_KEY, session_from_mapping, session_to_yaml
from calib.session.shutter import Shutter
from capture.disk import locked, write_durably, writing
from capture.session_file import Setup, read_described, write_description


@dataclass(frozen=True, slots=True)
class Described:
    """What a session says that was begun."""

    camera: Camera
    pitch: Number
    """m"""


class PointsSession:
    """A session folder that is held by one program at a time, between entering and leaving the
    `with`.
    """

    def __init__(self, session: Path, like: Setup | None = None) -> None:
        """`like` gives cover and camera to a folder that has no session.yaml."""
        self.session = session
        self.remarks: list[str] = []
        """Sentences that a person should know."""
        self.described: Described | None = None
        """None: there is no session.yaml yet."""
        self.screen: tuple[int, int] | None = None
        """px, the size of the screen that the poses were taken with; None: there are none."""
        self.pixels: list[NDArray[np.float64]] = []
        """(N, 2) px, the points of each pose."""
        self._like = like
        self._folder = session / FOLDER
        self._resources = ExitStack()

    @property
    def _file(self) -> Path:
        return self.session / "session.yaml"

    def __enter__(self) -> Self:
        for place in (self._folder, self._file):
            if place.is_symlink():
                raise InputError(
                    f"{place} is a symbolic link, and nothing is recorded through one: put what it"
                    " leads to in its place, or record elsewhere."
                )
        with reading(self._file):
            is_described = self._file.exists()
        if is_described:
            self.described = self._read_described()
        with writing(self._folder):
            self._folder.mkdir(parents=True, exist_ok=True)
        with ExitStack() as stack:
            stack.enter_context(locked(self.session))
            self._resume()
            self._resources = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._resources.close()

    def describe(self, size: tuple[int, int], pitch: Number, shutter: Shutter | None) -> None:
        """Write session.yaml for pictures of this size in px and a screen of this pitch in m."""
        width, height = size
        camera, cover = Camera(width, height, shutter=shutter), Cover("none", {})
        if self._like:
            cover = self._like[2]
            if (self._like[1].width, self._like[1].height) == size:
                camera = self._like[1]
        target = PointTarget.of(np.zeros((0, 2)), pitch)
        document = {"format": FORMAT, **session_to_yaml(target, camera, cover)}
        text = yaml.safe_dump(document, sort_keys=False, allow_unicode=True)
        write_description(self._file.parent, text)
        self.described = Described(camera, pitch)
        self.remarks.append(
            f"Wrote {self._file} with cover.shape {cover.shape}: correct it there if the camera's"
            " cover is another."
        )

    def keep(self, points: ScreenPoints, screen: tuple[int, int]) -> Path:
        """Write the points of a pose under the next free number, and the screen's size in px."""
        number = len(self.pixels)
        while os.path.lexists(path := self._folder / f"{number:04d}.npz"):
            number += 1
        data = io.BytesIO()
        np.savez(
            data,
            pixels=points.pixels,
            target=points.target,
            covariance=points.covariance,
            screen=np.array(screen, np.float64),
        )
        write_durably(path, data.getbuffer())
        self.pixels.append(points.pixels)
        self.screen = screen
        return path

    def _read_described(self) -> Described:
        board, camera, cover = read_described(self._file)
        if not isinstance(board, PointTarget):
            raise InputError(
                f"{self._file} describes a board: record a screen into another folder."
            )
        if board.pitch is None:
            raise InputError(
                f"{self._file} lacks the screen's {TARGET_KEY}.pitch_mm: write the millimetres from"
                f" pixel to pixel, such as {TARGET_KEY}: {{type: points, pitch_mm: 0.1794}}."
            )
        if self._like and self._like[2] != cover:
            raise InputError(
                f"{self._file} describes another cover than --cover-from's: leave that out,"
                " correct the file, or record elsewhere."
            )
        return Described(camera, board.pitch)

    def _resume(self) -> None:
        """Read the poses that are there, and remove what a kill left."""
        for folder in (self.session, self._folder):
            for stale in folder.glob(f".refracal-{16 * '[0-9a-f]'}.tmp"):  # its writer has ended
                stale.unlink()
        for path in sorted(self._folder.glob("*.npz")):
            with reading(path):
                data = read_file(path)
            try:
                arrays = decode_npz(data)
                self.pixels.append(np.asarray(arrays["pixels"], np.float64).reshape(-1, 2))
                width, height = arrays["screen"]
            except (ValueError, KeyError, TypeError) as error:
                raise InputError(
                    f"{path} is not a pose that this program wrote: move it elsewhere, or record"
                    " into another folder."
                ) from error
            self.screen = int(width), int(height)


def read_template(file: Path) -> Setup:
    """Return camera and cover of another session.yaml, whatever its target is."""
    written = read_yaml(file)
    setup: dict[str, object] = {key: written[key] for key in ("camera", "cover") if key in written}
    return session_from_mapping({TARGET_KEY: {"type": "points"}} | setup, str(file))
