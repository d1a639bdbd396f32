"""The advice where to hold the board next: from a plain rule at once, and from the expected gain
for the undistortion maps once a process has computed it.
"""

from collections.abc import Iterator, Sequence

from calib.session.camera import Camera, read_camera
from calib.session.schema import Section
from capture.coverage import Guide, Hint, KeptView, PlainGuide, SessionProgress
from capture.guidance import Guidance, GuidanceError
from capture.tui.camera import Task
from capture.tui.child import Child
from capture.tui.fit_requirements import has_bare
from capture.tui.lens import ENOUGH_BARE_VIEWS, find_lens

NOT_COMPUTED_YET = "The accuracy of the maps is not computed yet."
AFTER_FIRST_VIEW = "The accuracy of the maps is computed after the first view."
LENS_BY_FIT = (
    "The lens of these pictures is not known yet. The fit finds it, and says how accurate the maps"
    " are: press f."
)
LENS_FIRST = (
    "The lens is being found from the views without the cover. How accurate the maps will be comes"
    " after that."
)
COMPUTED = "How accurate the maps will be is being computed. That takes some seconds."
Advice = tuple[Hint | None, SessionProgress]


class Adviser:
    """The adviser of one recording. Some methods block, so it belongs into a thread.

    `close` ends its processes, from any thread.
    """

    def __init__(self, task: Task, size: tuple[int, int]) -> None:
        """`size` is that of the camera's pictures, px. Blocks for some tenths of a second."""
        board, camera, _ = task.setup
        self.remark = _initial_remark(task)
        """The reason why the plain rule serves; empty where the maps' uncertainty is computed."""
        self._task = task
        self._camera = camera if (camera.width, camera.height) == size else Camera(*size)
        self._plain = PlainGuide(board, self._camera)
        self._guide: Guide = self._plain
        self._lens = Child(find_lens, task.session)
        self._guidance: Guidance | None = None
        self._closed = False

    def advise(self, views: Sequence[KeptView]) -> Advice:
        return self._guide.next_pose(views), self._guide.progress(views)

    def improve(self, views: Sequence[KeptView]) -> Iterator[None]:
        """Compute better advice from these views; at each step, the advice has improved.

        Blocks for seconds.
        """
        if self._task.bare or self._task.setup[2].shape == "none":
            return
        if not views and self._camera.intrinsics is None and has_bare(self._task.session):
            self.remark = (
                AFTER_FIRST_VIEW  # the lens comes from a session, which has pictures in frames/
            )
            yield
            return
        if self.remark == AFTER_FIRST_VIEW:
            self.remark = NOT_COMPUTED_YET
        try:
            if self._guidance is None:
                self._guidance = self._prepare_guidance()
            for guide in self._guidance.guides(views):
                self._guide, self.remark = guide, ""
                yield
        except GuidanceError as error:
            self._guide, self.remark = self._plain, str(error)
            yield

    @property
    def awaited(self) -> str:
        """The sentence on what is missing for the accuracy of the maps, and when it comes."""
        return COMPUTED if self._guidance else find_awaited(self._task, self._camera)

    def close(self) -> None:
        self._closed = True
        self._lens.kill()
        if self._guidance:
            self._guidance.close()

    def _prepare_guidance(self) -> Guidance:
        board, _, cover = self._task.setup
        camera = self._camera
        if camera.intrinsics is None:
            if not has_bare(self._task.session):
                raise GuidanceError(
                    f"The accuracy of the maps is computed by the fit: {self._missing_lens()}."
                )
            *_, last = {"sentence": "The search for the lens was ended."}, *self._lens.events()
            if "camera" not in last:
                raise GuidanceError(last["sentence"])
            camera = read_camera(Section(last["camera"], "The lens"))
        guidance = Guidance(board, camera, cover)
        if self._closed:
            guidance.close()
        return guidance

    def _missing_lens(self) -> str:
        camera = self._task.setup[1]
        if camera.intrinsics is None:
            return "the lens is not known"
        calibrated = f"{camera.width}x{camera.height}"
        size = f"{self._camera.width}x{self._camera.height}"
        return f"the known lens is for pictures of {calibrated} px, and these have {size}"


def find_awaited(task: Task, camera: Camera) -> str:
    """Return the sentence on what is missing for the accuracy of the maps before anything is
    computed.
    """
    if camera.intrinsics is not None:
        return COMPUTED
    return LENS_FIRST if has_bare(task.session) else LENS_BY_FIT


def _initial_remark(task: Task) -> str:
    """Return the remark for the plain rule, before better advice exists."""
    if task.bare:
        return f"From {ENOUGH_BARE_VIEWS} views on you may go on (n); more improve the lens."
    if task.setup[2].shape == "none":
        return "The fit computes the accuracy of the maps."
    return NOT_COMPUTED_YET
