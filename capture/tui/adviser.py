"""Where to hold the board next: by a plain rule at once, and by what the undistortion maps lack as
soon as a process has computed that.
"""

from collections.abc import Iterator, Sequence

from calib.session.camera import Camera, read_camera
from calib.session.schema import Section
from capture.coverage import Guide, Hint, KeptView, PlainGuide, SessionProgress
from capture.guidance import Guidance, GuidanceError
from capture.tui.camera import Task
from capture.tui.child import Child
from capture.tui.fit_requirements import has_bare
from capture.tui.lens import ENOUGH, find_lens

NOT_YET = "How sure the maps would be is not computed yet."
AFTER_ONE = "How sure the maps would be is computed after the first view."
Advice = tuple[Hint | None, SessionProgress]


class Adviser:
    """Blocks where it says so, and then belongs into a thread.

    `close` ends its processes, from any thread.
    """

    def __init__(self, task: Task, size: tuple[int, int]) -> None:
        """`size`: of the camera's pictures, px. Blocks for some tenths of a second."""
        board, camera, _ = task.asked
        self.remark = _not_computed(task)
        """Why the plain rule serves; empty where how sure the maps would be is computed."""
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
        """Look into what these views tell; at each step, the advice has become better.

        Blocks for seconds.
        """
        if self._task.bare or self._task.asked[2].shape == "none":
            return
        if not views and self._camera.intrinsics is None and has_bare(self._task.session):
            self.remark = (
                AFTER_ONE  # the lens is looked for in a session, which has pictures in frames/
            )
            yield
            return
        if self.remark == AFTER_ONE:
            self.remark = NOT_YET
        try:
            if self._guidance is None:
                self._guidance = self._prepared()
            for guide in self._guidance.guides(views):
                self._guide, self.remark = guide, ""
                yield
        except GuidanceError as error:
            self._guide, self.remark = self._plain, str(error)
            yield

    def close(self) -> None:
        self._closed = True
        self._lens.kill()
        if self._guidance:
            self._guidance.close()

    def _prepared(self) -> Guidance:
        board, _, cover = self._task.asked
        camera = self._camera
        if camera.intrinsics is None:
            if not has_bare(self._task.session):
                raise GuidanceError(
                    f"How sure the maps would be cannot be computed: {self._lacks()}."
                )
            *_, last = {"sentence": "The lens is not looked for any more."}, *self._lens.events()
            if "camera" not in last:
                raise GuidanceError(last["sentence"])
            camera = read_camera(Section(last["camera"], "The lens"))
        guidance = Guidance(board, camera, cover)
        if self._closed:
            guidance.close()
        return guidance

    def _lacks(self) -> str:
        known = self._task.asked[1]
        if known.intrinsics is None:
            return "the lens is not known"
        wanted, size = (
            f"{known.width}x{known.height}",
            f"{self._camera.width}x{self._camera.height}",
        )
        return f"the lens that is known is of pictures of {wanted} px, and these are {size}"


def _not_computed(task: Task) -> str:
    """What is said beside the plain rule, before anything better is there."""
    if task.bare:
        return f"From {ENOUGH} views on you may go on (n); more make the lens surer."
    if task.asked[2].shape == "none":
        return "The fit computes how sure the maps are."
    return NOT_YET
