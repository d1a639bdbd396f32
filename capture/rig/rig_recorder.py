"""The writer of a rig's folder: a session folder a camera, and rig.yaml.

The pictures of one moment have the same name in all sessions, so rig.yaml says `together: by_name`.
Each session is written as `capture.recorder` writes one, so that no picture is lost. If a recording
is killed between the pictures of one moment, those that are written count as views of their cameras
alone.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType

from calib.errors import InputError
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.shutter import Shutter
from capture.recorder import Recorder
from capture.rig.pairing import Moment
from capture.rig.rig_folder import RigFolder
from capture.session_file import Setup, read_setup


class RigRecorder:
    """A recorder of all cameras of a rig, opened by `with`."""

    def __init__(
        self,
        rig: RigFolder,
        board: Board,
        *,
        likes: Mapping[str, Setup],
        shutters: Mapping[str, Shutter | None],
    ) -> None:
        """`likes` gives cover and camera to sessions that are not described, and `shutters` has
        the shutters of the sources' sensors.
        """
        self.rig = rig
        self._likes = likes
        self.recorders = {
            name: Recorder(session, board, like=likes.get(name), shutter=shutters[name])
            for name, session in rig.sessions.items()
        }
        self._own_remarks: list[str] = []
        self._resources = ExitStack()

    @property
    def remarks(self) -> Sequence[str]:
        """Sentences that a person should know about this recording."""
        return [
            *self._own_remarks,
            *(
                f"{name}: {remark}"
                for name, recorder in self.recorders.items()
                for remark in recorder.remarks
            ),
        ]

    def __enter__(self) -> "RigRecorder":
        with ExitStack() as stack:
            for recorder in self.recorders.values():
                stack.enter_context(recorder)
            self._resources = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._resources.close()

    def cameras(self, sizes: Mapping[str, tuple[int, int]]) -> dict[str, Camera]:
        """Return the cameras as their sessions describe them, for pictures of these widths and
        heights, px.
        """
        cameras = {}
        for name, size in sizes.items():
            file = self.rig.sessions[name] / "session.yaml"
            described = read_setup(file) if file.exists() else self._likes.get(name)
            fits = described and (described[1].width, described[1].height) == size
            cameras[name] = described[1] if described and fits else Camera(*size)
        return cameras

    def check(self, moment: Moment) -> None:
        """Raise InputError if a frame has another size than its session's pictures."""
        for name, frame in moment.frames.items():
            try:
                self.recorders[name].check(frame)
            except InputError as error:
                raise InputError(f"{name}: {error}") from error

    def keep(
        self, moment: Moment, cameras: Sequence[str], *, same_view: bool = False
    ) -> dict[str, Path]:
        """Write the frames of some cameras as the next pictures, which get the same name.

        `same_view`: the board stands where it stood in the last pictures.
        """
        self.check(moment)
        if self.rig.describe():
            self._own_remarks.append(
                f"Wrote {self.rig.file}: add shared_cover if the cameras look through one window,"
                " and baseline_mm if you measured it."
            )
        for name, recorder in self.recorders.items():
            recorder.describe(moment.frames[name].size)
        number = max(recorder.next_number for recorder in self.recorders.values())
        while not all(recorder.is_free(number) for recorder in self.recorders.values()):
            number += 1
        return {
            name: self.recorders[name].keep(moment.frames[name], same_view=same_view, number=number)
            for name in cameras
        }
