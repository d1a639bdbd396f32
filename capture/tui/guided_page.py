"""A page with a guide, which runs in threads: it says where the board should come next, and how
accurate the maps would be.
"""

from abc import abstractmethod
from collections.abc import Sequence
from threading import Lock
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from textual import on, work
from textual.message import Message

from capture.coverage import Hint, KeptView, SessionProgress
from capture.tui.adviser import Adviser, find_awaited
from capture.tui.camera import Task
from capture.tui.page import Page

AGAIN_S = 0.1  # s, after which the page checks again whether the size of the pictures is known


class GuidedPage(Page):
    MAPS: ClassVar = True
    """True if these views are for maps, so that the guide computes the maps' uncertainty."""

    class AdviceReady(Message):
        """The guide has new advice about the views."""

        def __init__(self, count: int, hint: Hint | None, progress: SessionProgress) -> None:
            super().__init__()
            self.count = count
            self.hint = hint
            self.progress = progress

    class GuideImproved(Message):
        """A better guide has arrived, or the last one for these views."""

        def __init__(self, *, done: bool) -> None:
            super().__init__()
            self.done = done

    def __init__(self, task: Task) -> None:
        super().__init__()
        self.plan = task
        self.view_corners: list[NDArray[np.float64]] = []
        """The corners of the session's views."""
        self._adviser: Adviser | None = None
        self._adviser_lock = Lock()  # of the threads that use the adviser
        self._improving = False
        self._improved_views = -1  # views
        self._unmounted = False

    @abstractmethod
    def picture_size(self) -> tuple[int, int] | None:
        """Return width and height of the pictures, px; None before the first one."""

    @abstractmethod
    def show_advice(self, hint: Hint | None, progress: SessionProgress) -> None:
        """Show the guide's advice about the present views."""

    @property
    def is_improving(self) -> bool:
        """True while a better guide is computed."""
        return self._improving

    @property
    def guide_remark(self) -> str:
        """The reason why the guide is not the best one; empty where it is."""
        return self._adviser.remark if self.MAPS and self._adviser else ""

    @property
    def awaited(self) -> str:
        """The sentence on what is missing for the accuracy of the maps, and when it comes."""
        if self._adviser:
            return self._adviser.awaited
        return find_awaited(self.plan, self.plan.setup[1])

    def request_advice(self) -> None:
        """Ask the guide about the present views."""
        if (size := self.picture_size()) is None:
            self.set_timer(AGAIN_S, self.request_advice)
            return
        self._advise(size, self._views())

    def _views(self) -> list[KeptView]:
        return [KeptView(corners) for corners in self.view_corners]

    @work(thread=True, group="advice", description="advises")
    def _advise(self, size: tuple[int, int], views: Sequence[KeptView]) -> None:
        """Advise, one request after the other. While better advice is computed, the next view gets
        the best that exists.
        """
        with self._adviser_lock:
            if self._adviser is None:
                self._adviser = Adviser(self.plan, size)
                if self._unmounted:
                    self._adviser.close()
            self.post_message(self.AdviceReady(len(views), *self._adviser.advise(views)))

    @work(thread=True, group="improvement", description="improves the guide")
    def _improve(self, adviser: Adviser, views: Sequence[KeptView]) -> None:
        for _ in adviser.improve(views):
            self.post_message(self.GuideImproved(done=False))
        self.post_message(self.GuideImproved(done=True))

    @on(GuideImproved)
    def _handle_improvement(self, message: GuideImproved) -> None:
        if message.done:
            self._improving = False
        self.request_advice()

    @on(AdviceReady)
    def _handle_advice(self, message: AdviceReady) -> None:
        if message.count != len(self.view_corners):
            return
        assert self._adviser
        if self.MAPS and not self._improving and self._improved_views != len(self.view_corners):
            self._improving, self._improved_views = True, len(self.view_corners)
            self._improve(self._adviser, self._views())
        self.show_advice(message.hint, message.progress)

    def on_unmount(self) -> None:
        self._unmounted = True
        if self._adviser:
            self._adviser.close()
