"""Where a board tells most about this camera and its cover: asked here, and answered by a process
that fits the views with torch.

`Guidance` sends the process a `Request` with every view there is, and gets one `Answer` or two.
Both ends are this file.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection
from threading import Lock

import numpy as np
from numpy.typing import NDArray

from calib.errors import RefracalError
from calib.planning.design import Design
from calib.planning.pose_bank import Reach, make_pose_bank
from calib.session.board import Board
from calib.session.camera import Camera
from calib.session.cover import Cover
from capture.coverage import CELLS, TARGET, InformedGuide, SeenView
from capture.process import Process

GRID = (12, 12)  # centres of the relief, as a fit has them
FOLDS = 4
FEWEST_FOR_FOLDS = 6  # views
# held-out over fitted error up to which folds agree, as calib.fitting.cross_validation.OVERFITS
AGREE = 1.25


class GuidanceError(RefracalError):
    """There is no informed guide; the plain one serves meanwhile."""


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    board: Board
    camera: Camera
    cover: Cover
    reach: Reach
    views: tuple[NDArray[np.float64], ...]
    """(count, 2) px each, NaN where not seen."""
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
    """Asks the process, which is started with the first question and again after it has died.

    `close` ends it, from any thread.
    """

    def __init__(
        self,
        board: Board,
        camera: Camera,
        cover: Cover,
        reach: Reach | None = None,
        target_px: float = TARGET,
    ) -> None:
        self._board, self._camera, self._cover, self._target = board, camera, cover, target_px
        self._reach = reach or Reach.of(board, camera)
        self._turn = Lock()
        self._process: Process | None = None
        self._asked = 0
        self._answering = self._closed = False

    @property
    def pid(self) -> int:
        """0 before it is started."""
        return self._process.pid if self._process else 0

    def guides(self, views: Sequence[SeenView]) -> Iterator[InformedGuide]:
        """The guide that knows these views, seconds later; and perhaps once more, when folds over
        them have been tried. Blocks.

        A later question, from another thread, ends it.

        Raises:
            GuidanceError: torch is absent, the views cannot be fitted, or the process has died.
        """
        number = self._ask(
            Request(
                self._board,
                self._camera,
                self._cover,
                self._reach,
                tuple(v.corners for v in views),
                self._target,
            )
        )
        while (answer := self._answer(number)) is not None:
            if answer.design is None:
                raise GuidanceError(answer.failure)
            agree, target = answer.folds_agree, self._target
            yield InformedGuide(
                self._board,
                self._camera,
                self._reach,
                answer.design,
                folds_agree=agree,
                target_px=target,
            )
            if answer.last:
                return

    def close(self) -> None:
        self._closed = True
        if process := self._process:
            process.kill()  # who waits for an answer then finds that there is none
        with self._turn:
            if self._process:
                self._process.kill()  # it may have been started just now
                self._process.end()
                self._process = None

    def _ask(self, request: Request) -> int:
        with self._turn:
            while self._answering:  # an answer that nobody waits for any more
                self._read()
            self._asked += 1
            if not self._closed:
                self._process = self._process or Process(serve)
                self._answering = True
                self._process.send(request)
            return self._asked

    def _answer(self, number: int) -> Answer | None:
        """The next answer to a question; None if a later one was asked since, or after `close`."""
        with self._turn:
            answer = self._read() if number == self._asked and not self._closed else None
            return None if self._closed else answer

    def _read(self) -> Answer:
        assert self._process
        try:
            answer = self._process.receive()
            assert isinstance(answer, Answer)
        except EOFError:
            answer = Answer(
                None,
                failure=(
                    f"The guide's process has ended ({self._process.end().words}): the next view"
                    " starts it again."
                ),
            )
            self._process = None
        self._answering = not answer.last
        return answer


def answers(request: Request) -> Iterator[Answer]:
    """In the process: first the design, and if that is sure enough, once more with the folds."""
    if request.camera.intrinsics is None or request.cover.shape == "none":
        yield Answer(
            None,
            failure=(
                "The informed guide needs a cover and the camera's intrinsics: the plain one serves"
                " without."
            ),
        )
        return
    from calib.corners.view import View
    from calib.fitting.cross_validation import cross_validate
    from calib.fitting.stages import Settings, Setup
    from calib.planning.information import estimate
    from calib.progress import Silent
    from calib.threads import single_thread

    views = [
        View(f"{number:04d}", corners, np.isfinite(corners[:, 0]).astype(np.float64))
        for number, corners in enumerate(request.views)
    ]
    setup = Setup(request.board, request.camera, request.camera.intrinsics, request.cover)
    poses = make_pose_bank(request.board, request.camera, request.reach).poses
    with single_thread():
        design = estimate(setup, views, GRID).design(setup, poses, CELLS, request.reach.levels())
        try_folds = (
            len(views) >= FEWEST_FOR_FOLDS and design.sigma(design.precision()) <= request.target_px
        )
        yield Answer(design, last=not try_folds)
        if try_folds:
            found = cross_validate(setup, views, Settings(grid=GRID), FOLDS, Silent())
            yield Answer(design, found.held_out_px <= AGREE * found.fitted_px)


def serve(connection: Connection) -> None:
    """In the process: answer requests until nobody asks any more."""
    while True:
        try:
            request = connection.recv()
        except EOFError:
            return
        try:
            for answer in answers(request):
                connection.send(answer)
        except ImportError as error:
            connection.send(
                Answer(
                    None, failure=f"This machine has no torch, so the plain guide serves ({error})."
                )
            )
        except RefracalError as error:
            connection.send(Answer(None, failure=str(error)))
