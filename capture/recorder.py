"""The writer of a session folder. It loses nothing: not to a kill, not to a full disk, not to a
second recorder.

A picture is written under a temporary name, forced to the disk and renamed; then its row is added
to frames.csv. So the folder is a valid session at every moment, and a recording that was cut short
continues with the next recording.
"""

import os
import time
from contextlib import ExitStack
from itertools import count
from pathlib import Path
from types import TracebackType

import cv2

from calib.errors import InputError
from calib.io.files import reading
from calib.io.frames_table import (
    NAME,
    Row,
    columns,
    is_by_hand,
    last_view,
    match_pictures,
    read_table,
    to_csv,
)
from calib.io.images import list_images
from calib.session.board import Board
from calib.session.shutter import Shutter, shutter_to_yaml
from capture.disk import append_durably, locked, write_durably, writing
from capture.frames import Frame
from capture.session_file import Setup, picture_folder, read_setup, write_setup
from capture.settings_drift import SettingsDrift

PNG = (
    cv2.IMWRITE_PNG_COMPRESSION,
    1,
    cv2.IMWRITE_PNG_STRATEGY,
    cv2.IMWRITE_PNG_STRATEGY_HUFFMAN_ONLY,
)
"""The fastest encoding, and the smallest on noisy pictures: filters and repetitions find nothing in
noise.
"""

BY_HAND = "frames-by-hand"
"""Keeps a table that a person made, where the recorder goes on with it in its own form."""
DROPPED = "dropped"
"""The subfolder for pictures that a person has set aside."""


class Recorder:
    """A recorder of one session folder. It is opened by `with`, and one recorder at a time holds a
    folder.
    """

    def __init__(
        self,
        session: Path,
        board: Board,
        *,
        like: Setup | None = None,
        bare: bool = False,
        shutter: Shutter | None = None,
    ) -> None:
        """`like` gives cover and camera to a folder that has no session.yaml, and `shutter` is the
        shutter of the source's sensor; `bare` records the camera without its cover.
        """
        self.session = session
        self.remarks: list[str] = []
        """Sentences that a person should know about this recording, in the order in which they
        arise.
        """
        self._board = board
        self._like = like
        self._shutter = shutter
        self._folder = picture_folder(session, bare=bare)
        self._table = (self._folder if bare else session) / NAME
        self._rows: list[Row] = []
        self._columns: list[str] = []
        self._settings = SettingsDrift()
        self._size: tuple[int, int] | None = None
        self._next = 0
        self._view = -1
        self._unix_offset = time.time() - time.monotonic()  # s
        self._resources = ExitStack()

    @property
    def pictures(self) -> tuple[Path, ...]:
        """The recorded pictures, in their order."""
        return list_images(self._folder)

    @property
    def set_aside(self) -> tuple[Path, ...]:
        """The pictures that a person has set aside."""
        folder = self._folder / DROPPED
        return list_images(folder) if folder.is_dir() else ()

    def __enter__(self) -> "Recorder":
        with reading(self._folder):
            is_inner_session = (self._folder / "session.yaml").exists()
        if is_inner_session and self._folder != self.session:
            raise InputError(
                f"{self._folder} is a session of its own: record into it by"
                f" `capture record {self._folder}`, without --bare."
            )
        for place in (self._folder, self._table):
            if place.is_symlink():
                raise InputError(
                    f"{place} is a symbolic link, and nothing is recorded through one: put what it"
                    " leads to in its place, or record elsewhere."
                )
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

    def check(self, frame: Frame) -> None:
        """Raise InputError if the frame has another size than the session's pictures."""
        if self._size and self._size != frame.size:
            width, height = frame.size
            session_width, session_height = self._size
            raise InputError(
                f"{frame.name or 'The picture'} is {width}x{height} px where"
                f" {self.session / 'session.yaml'} says {session_width}x{session_height}: set the"
                f" camera to that size (?size={session_width}x{session_height} after the source),"
                " or record another session."
            )

    @property
    def next_number(self) -> int:
        """The lowest number that the next picture may have."""
        return self._next

    def is_free(self, number: int) -> bool:
        """Return True if no picture, nor anything else, has this number."""
        return not os.path.lexists(self._folder / f"{number:04d}.png")

    def describe(self, size: tuple[int, int]) -> None:
        """Write session.yaml for pictures of this width and height, px, where there is none."""
        if self._size is None:
            self._describe(size)

    def keep(self, frame: Frame, *, same_view: bool = False, number: int | None = None) -> Path:
        """Write a frame as the next picture. A picture of a folder keeps its name, so that results
        name it as the person does.

        Args:
            same_view: the board stands where it stood in the last picture.
            number: of the picture, at least `next_number`; None for its own name, or for the next
                number if it has none or another picture has it.
        """
        self.check(frame)
        self.describe(frame.size)
        if number is not None:
            self._next = max(number, self._next)
        # frames.csv is UTF-8: of any other byte of a name, both have the escape
        stem = os.fsencode(Path(frame.name).stem).decode(errors="backslashreplace")
        if number is None and stem and not self._has(stem):
            picture = self._folder / f"{stem}.png"
        else:
            picture = self._free_picture()
            self._next += 1
        write_durably(picture, cv2.imencode(".png", frame.pixels, PNG)[1].data)
        self._view += not same_view
        self._append_row(
            {
                "file": picture.name,
                "time_s": f"{frame.time_s + self._unix_offset:.6f}",
                "sequence": str(frame.sequence),
                "view": str(self._view),
                **{key: str(value) for key, value in frame.metadata.items()},
            }
        )
        return picture

    def _has(self, stem: str) -> bool:
        """Return True if the folder has a file of this name, of whatever type and case."""
        return any(path.stem.casefold() == stem.casefold() for path in self._folder.iterdir())

    def _free_picture(self) -> Path:
        """Return the path of the next picture, where nothing exists: no file is ever replaced."""
        while not self.is_free(self._next):
            self._next += 1
        return self._folder / f"{self._next:04d}.png"

    def _append_row(self, row: Row) -> None:
        self._rows.append(row)
        if set(row) <= set(self._columns):
            append_durably(self._table, to_csv([row], self._columns, header=False))
        else:
            self._columns = columns(self._rows)
            write_durably(self._table, to_csv(self._rows, self._columns))
        self.remarks += self._settings.find_changes(row)

    def _resume(self) -> None:
        """Continue from the end of the last recording, and repair what a kill left."""
        with reading(self._folder):
            for folder in (self._folder, self._table.parent):
                for stale in folder.glob(
                    f".refracal-{16 * '[0-9a-f]'}.tmp"
                ):  # its writer has ended: the session is ours
                    stale.unlink()
        if (self.session / "session.yaml").exists():
            _, camera, _ = read_setup(self.session / "session.yaml")
            self._size = camera.width, camera.height
            self._compare_shutter(camera.shutter)
        pictures = self.pictures
        for table in (self.session / "bare" / NAME, self.session / NAME):
            for row in read_table(table):
                self._settings.find_changes(row)
        recorded = read_table(self._table)
        self._rows = match_pictures(recorded, pictures)
        if (
            recorded
            and pictures
            and not {row["file"] for row in recorded} & {picture.name for picture in pictures}
        ):
            raise InputError(
                f"{self._table} lists {recorded[0]['file']} and no picture in {self._folder}:"
                f" write names such as {pictures[0].name} into its column file, or remove the"
                " table."
            )
        if self._rows:
            self._columns = columns(self._rows)
            text = to_csv(self._rows, self._columns)
            if not self._table.exists() or self._table.read_text(errors="replace") != text:
                self._keep_table_by_hand()
                write_durably(self._table, text)
        self._next = 1 + max(
            (int(picture.stem) for picture in pictures if picture.stem.isdecimal()), default=-1
        )
        self._view = last_view(self._rows)

    def _keep_table_by_hand(self) -> None:
        """Copy a person's table beside itself, before the recorder writes it in its own form."""
        if not is_by_hand(self._table):
            return
        copy = next(
            place
            for number in count()
            if not os.path.lexists(
                place := self._table.with_name(f"{BY_HAND}{f'-{number}' if number else ''}.csv")
            )
        )
        write_durably(copy, self._table.read_bytes())
        self.remarks.append(
            f"{self._table} was made by hand: a copy stays as {copy.name}, for the recorder goes on"
            " with the table in its own form."
        )

    def _describe(self, size: tuple[int, int]) -> None:
        if (self.session / "session.yaml").is_symlink():
            raise InputError(
                f"{self.session / 'session.yaml'} is a symbolic link that leads nowhere: remove it,"
                " or record elsewhere."
            )
        cover = write_setup(self.session, self._board, size, self._like, self._shutter)
        self._size = size
        file = self.session / "session.yaml"
        self.remarks.append(
            f"Wrote {file} with cover.shape {cover.shape}: correct it there if the camera's cover"
            " is another."
        )

    def _compare_shutter(self, described: Shutter | None) -> None:
        """Compare the described shutter with the sensor's, if the driver names one."""
        sensor = self._shutter
        if sensor is None or (described and described.rolling == sensor.rolling):
            return
        kind, file = shutter_to_yaml(sensor)["type"], self.session / "session.yaml"
        why = (
            f"it says {shutter_to_yaml(described)['type']}"
            if described
            else "the diagnosis then names no effect that this shutter cannot have"
        )
        self.remarks.append(
            f"The camera's sensor has a {kind} shutter: write camera.shutter: {{type: {kind}}} in"
            f" {file} ({why})."
        )
