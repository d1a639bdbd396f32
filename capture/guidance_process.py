"""The informed guide, computed in a process of its own: torch loads there, and never in the process that draws the screen.

A request is a pickled `Request` on the process's stdin, an answer a pickled `Answer` on its stdout. Both ends are this file.
"""

import os
import pickle
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from tempfile import TemporaryFile
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from calib.errors import RefracalError
from calib.planning.design import Design
from calib.planning.pose_bank import Reach, bank
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.cover import Cover
from capture.coverage import CELLS, TARGET, InformedGuide, SeenView

NICENESS = 10  # the screen and the camera go first
GRID = (12, 12)  # centres of the relief, as a fit has them
FOLDS = 4
FEWEST_FOR_FOLDS = 6  # views
AGREE = 1.25  # held-out over fitted error up to which folds agree, as calib.fitting.cross_validation.OVERFITS


class GuidanceError(RefracalError):
    """There is no informed guide; the plain one serves meanwhile."""


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    board: Board
    camera: Camera
    cover: Cover
    reach: Reach
    views: tuple[NDArray[np.float64], ...]
    """(count, 2) px each."""
    target_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    design: Design | None
    folds_agree: bool | None = None
    """None: not tried, for the maps are not sure enough yet, or not tried yet."""
    failure: str = ""
    last: bool = True
    """Whether no other answer to the same request follows."""


class Guidance:
    """Asks the process, which is started with the first question and again after it has died. `close` ends it, from any thread."""

    def __init__(self, board: Board, camera: Camera, cover: Cover, reach: Reach | None = None, target_px: float = TARGET) -> None:
        self._board, self._camera, self._cover, self._target = board, camera, cover, target_px
        self._reach = reach or Reach.of(board, camera)
        self._turn = Lock()
        self._child: _Child | None = None
        self._asked = 0
        self._answering = self._closed = False

    @property
    def pid(self) -> int:
        """0 before it is started."""
        return self._child.process.pid if self._child else 0

    def guides(self, views: Sequence[SeenView]) -> Iterator[InformedGuide]:
        """The guide that knows these views, seconds later; and perhaps once more, when folds over them have been tried. Blocks.

        A later question, from another thread, ends it.

        Raises:
            GuidanceError: torch is absent, the views cannot be fitted, or the process has died.
        """
        number = self._ask(Request(self._board, self._camera, self._cover, self._reach, tuple(v.corners for v in views), self._target))
        while (answer := self._answer(number)) is not None:
            if answer.design is None:
                raise GuidanceError(answer.failure)
            agree, target = answer.folds_agree, self._target
            yield InformedGuide(self._board, self._camera, self._reach, answer.design, folds_agree=agree, target_px=target)
            if answer.last:
                return

    def close(self) -> None:
        self._closed = True
        if self._child:
            self._child.process.kill()  # who waits for an answer then finds that there is none
        with self._turn:
            if self._child:
                self._child.end()
                self._child = None

    def _ask(self, request: Request) -> int:
        with self._turn:
            while self._answering:  # an answer that nobody waits for any more
                self._read()
            self._asked += 1
            if not self._closed:
                self._child = self._child or _Child()
                self._answering = True
                with suppress(OSError):  # of a process that has died, which reading finds
                    self._child.send(request)
            return self._asked

    def _answer(self, number: int) -> Answer | None:
        """The next answer to a question; None if a later one was asked since, or after `close`."""
        with self._turn:
            answer = self._read() if number == self._asked and not self._closed else None
            return None if self._closed else answer

    def _read(self) -> Answer:
        assert self._child
        try:
            answer = self._child.receive()
        except (OSError, EOFError, pickle.UnpicklingError):
            answer = Answer(None, failure=f"The guide's process has ended ({self._child.end()}): the next view starts it again.")
            self._child = None
        self._answering = not answer.last
        return answer


class _Child:
    """The process, with its pipes."""

    def __init__(self) -> None:
        self._errors = TemporaryFile()  # noqa: SIM115 - closed by end
        command = [sys.executable, "-m", "capture.guidance_process"]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._errors)

    def send(self, request: Request) -> None:
        assert self.process.stdin
        pickle.dump(request, self.process.stdin)
        self.process.stdin.flush()

    def receive(self) -> Answer:
        assert self.process.stdout
        answer = pickle.load(self.process.stdout)
        assert isinstance(answer, Answer)
        return answer

    def end(self) -> str:
        """Kill it if it still lives, and what it said last."""
        self.process.kill()
        with suppress(OSError):
            self.process.communicate()  # which closes the pipes
        self._errors.seek(0)
        said = self._errors.read().decode(errors="replace").strip().splitlines()
        self._errors.close()
        return said[-1] if said else f"exit code {self.process.returncode}"


def answers(request: Request) -> Iterator[Answer]:
    """In the process: first the design, and if that is sure enough, once more with the folds."""
    if request.camera.intrinsics is None or request.cover.shape == "none":
        yield Answer(None, failure="The informed guide needs a cover and the camera's intrinsics: the plain one serves without.")
        return
    from calib.corners.view import View
    from calib.fitting.cross_validation import cross_validate
    from calib.fitting.stages import Settings, Setup
    from calib.planning.information import estimate
    from calib.progress import Silent
    from calib.threads import single_thread

    views = [View(f"{number:04d}", corners, np.ones(len(corners))) for number, corners in enumerate(request.views)]
    setup = Setup(request.board, request.camera, request.camera.intrinsics, request.cover)
    poses = bank(request.board, request.camera, request.reach).poses
    with single_thread():
        design = estimate(setup, views, GRID).design(setup, poses, CELLS, request.reach.levels())
        try_folds = len(views) >= FEWEST_FOR_FOLDS and design.sigma(design.known()) <= request.target_px
        yield Answer(design, last=not try_folds)
        if try_folds:
            found = cross_validate(setup, views, Settings(grid=GRID), FOLDS, Silent())
            yield Answer(design, found.held_out_px <= AGREE * found.fitted_px)


def serve() -> None:
    """Answer requests until stdin ends."""
    os.nice(NICENESS)
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not come between the answers
    while True:
        try:
            request = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        try:
            for answer in answers(request):
                pickle.dump(answer, out)
                out.flush()
        except ImportError as error:
            pickle.dump(Answer(None, failure=f"This machine has no torch, so the plain guide serves ({error})."), out)
        except RefracalError as error:
            pickle.dump(Answer(None, failure=str(error)), out)
        out.flush()


if __name__ == "__main__":
    from capture.guidance_process import serve as serve_imported  # so that what is pickled is not of the module __main__

    serve_imported()
