"""The informed guide's process, which fits the views with torch and plans the next pose.

`Guidance` sends the process a `Request` with all views, and gets one or two `Answer`s. Both ends
are in this file.
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
from capture.coverage import COVERAGE_CELLS, TARGET_SIGMA_PX, InformedGuide, KeptView
from capture.process import Process

RELIEF_GRID = (12, 12)  # the grid of the relief's centres, as in a fit
FOLD_COUNT = 4
MIN_VIEWS_FOR_FOLDS = 6  # views
# the held-out over the fitted error up to which the folds agree, as
# calib.fitting.cross_validation.OVERFITS
MAX_HELD_OUT_RATIO = 1.25


class GuidanceError(RefracalError):
    """No informed guide is available; the plain one serves meanwhile."""


@dataclass(frozen=True, slots=True, eq=False)
class Request:
    board: Board
    camera: Camera
    cover: Cover
    reach: Reach
    views: tuple[NDArray[np.float64], ...]
    """(count, 2) px each, NaN where not visible."""
    target_px: float


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    design: Design | None
    folds_agree: bool | None = None
    """None: not tried, or the maps are not accurate enough yet to try."""
    failure: str = ""
    last: bool = True
    """True if no other answer to the same request follows."""


class Guidance:
    """The client of the guide's process. The first request starts the process, and so does the next
    one after it has died.

    `close` ends it, from any thread.
    """

    def __init__(
        self,
        board: Board,
        camera: Camera,
        cover: Cover,
        reach: Reach | None = None,
        target_px: float = TARGET_SIGMA_PX,
    ) -> None:
        self._board, self._camera, self._cover, self._target = board, camera, cover, target_px
        self._reach = reach or Reach.of(board, camera)
        self._turn = Lock()
        self._process: Process | None = None
        self._requests = 0
        self._answering = self._closed = False

    @property
    def pid(self) -> int:
        """The process's number; 0 before it is started."""
        return self._process.pid if self._process else 0

    def guides(self, views: Sequence[KeptView]) -> Iterator[InformedGuide]:
        """Yield the guide that knows these views, seconds later, and perhaps once more when the
        folds over them have been tried. Blocks.

        A later request, from another thread, ends the iteration.

        Raises:
            GuidanceError: torch is absent, the views cannot be fitted, or the process has died.
        """
        number = self._send_request(
            Request(
                self._board,
                self._camera,
                self._cover,
                self._reach,
                tuple(v.corners for v in views),
                self._target,
            )
        )
        while (answer := self._next_answer(number)) is not None:
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
            process.kill()  # a caller that waits for an answer then gets none
        with self._turn:
            if self._process:
                self._process.kill()  # it may have been started a moment ago
                self._process.end()
                self._process = None

    def _send_request(self, request: Request) -> int:
        with self._turn:
            while self._answering:  # an answer that nobody waits for
                self._read()
            self._requests += 1
            if not self._closed:
                self._process = self._process or Process(serve_requests)
                self._answering = True
                self._process.send(request)
            return self._requests

    def _next_answer(self, number: int) -> Answer | None:
        """Return the next answer to a request; None if a later request was sent, or after
        `close`.
        """
        with self._turn:
            answer = self._read() if number == self._requests and not self._closed else None
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
                    f"The guide's process has ended ({self._process.end().reason}): the next view"
                    " starts it again."
                ),
            )
            self._process = None
        self._answering = not answer.last
        return answer


def answers(request: Request) -> Iterator[Answer]:
    """Run in the process: yield the design, and if it is accurate enough, once more with
    the folds.
    """
    if request.camera.intrinsics is None or request.cover.shape == "none":
        yield Answer(
            None,
            failure=(
                "The informed guide needs a cover and the camera's intrinsics. Without them, the"
                " plain guide serves."
            ),
        )
        return
    from calib.corners.view import View
    from calib.fit_record.request import Settings
    from calib.fitting.cross_validation import cross_validate
    from calib.fitting.setup import Setup
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
        design = estimate(setup, views, RELIEF_GRID).design(
            setup, poses, COVERAGE_CELLS, request.reach.levels()
        )
        try_folds = (
            len(views) >= MIN_VIEWS_FOR_FOLDS
            and design.sigma(design.precision()) <= request.target_px
        )
        yield Answer(design, last=not try_folds)
        if try_folds:
            validation = cross_validate(
                setup, views, Settings(grid=RELIEF_GRID), FOLD_COUNT, Silent()
            )
            yield Answer(
                design, validation.held_out_px <= MAX_HELD_OUT_RATIO * validation.fitted_px
            )


def serve_requests(connection: Connection) -> None:
    """Run in the process: answer requests until the connection closes."""
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
