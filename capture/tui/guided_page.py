"""A page whose views a guide thinks about, in threads of its own: where the board comes next, and
how sure the maps would be.
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
from capture.tui.adviser import Adviser
from capture.tui.camera import Task
from capture.tui.page import Page

AGAIN_S = 0.1  # after which it is asked once more how large the pictures are


class GuidedPage(Page):
    MAPS: ClassVar = True
    """Whether these views are for maps, of which the guide computes how sure they would be."""

    class Advised(Message):
        """The guide has thought about the views."""

        def __init__(self, count: int, hint: Hint | None, progress: SessionProgress) -> None:
            super().__init__()
            self.count = count
            self.hint = hint
            self.progress = progress

    class Improved(Message):
        """A better guide has come, or the last one of these views."""

        def __init__(self, *, done: bool) -> None:
            super().__init__()
            self.done = done

    def __init__(self, task: Task) -> None:
        super().__init__()
        self.plan = task
        self.kept: list[NDArray[np.float64]] = []
        """The corners of the views that there are."""
        self._adviser: Adviser | None = None
        self._turn = Lock()  # of the threads that ask the adviser
        self._improving = False
        self._improved_with = -1  # views
        self._left = False

    @abstractmethod
    def picture_size(self) -> tuple[int, int] | None:
        """Width and height of the pictures, px, once one has come."""

    @abstractmethod
    def advised(self, hint: Hint | None, progress: SessionProgress) -> None:
        """What the guide says of the views that there are."""

    @property
    def doubt(self) -> str:
        """Why the guide is not what it could be; empty where it is."""
        return self._adviser.remark if self.MAPS and self._adviser else ""

    def think(self) -> None:
        """Ask the guide about the views that there are."""
        if (size := self.picture_size()) is None:
            self.set_timer(AGAIN_S, self.think)
            return
        self._advise(size, self._views())

    def _views(self) -> list[KeptView]:
        return [KeptView(corners) for corners in self.kept]

    @work(thread=True, group="advice", description="advises")
    def _advise(self, size: tuple[int, int], views: Sequence[KeptView]) -> None:
        """One advice after the other; while a better one is computed, the next view gets the best
        that there is.
        """
        with self._turn:
            if self._adviser is None:
                self._adviser = Adviser(self.plan, size)
                if self._left:
                    self._adviser.close()
            self.post_message(self.Advised(len(views), *self._adviser.advise(views)))

    @work(thread=True, group="improvement", description="improves the guide")
    def _improve(self, adviser: Adviser, views: Sequence[KeptView]) -> None:
        for _ in adviser.improve(views):
            self.post_message(self.Improved(done=False))
        self.post_message(self.Improved(done=True))

    @on(Improved)
    def _improved(self, message: Improved) -> None:
        if message.done:
            self._improving = False
        if not message.done or len(self.kept) != self._improved_with:
            self.think()

    @on(Advised)
    def _guided(self, message: Advised) -> None:
        if message.count != len(self.kept):
            return
        assert self._adviser
        if self.MAPS and not self._improving and self._improved_with != len(self.kept):
            self._improving, self._improved_with = True, len(self.kept)
            self._improve(self._adviser, self._views())
        self.advised(message.hint, message.progress)

    def on_unmount(self) -> None:
        self._left = True
        if self._adviser:
            self._adviser.close()
