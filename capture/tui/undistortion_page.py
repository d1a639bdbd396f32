"""A page whose live picture can be shown undistorted: its action asks for a depth, a process makes
the maps, and once more ends it.
"""

from abc import abstractmethod
from pathlib import Path

from textual import on, work

from capture.tui.child import Child
from capture.tui.depth import DepthScreen
from capture.tui.live_undistortion import Straight, straighten
from capture.tui.page import Page, Said

DEPTH = 1.0  # m, proposed until another was chosen
SAID_S = 6.0  # for which it is said what becomes of the maps


class StraighteningPage(Page):
    class Straightened(Said):
        """The maps have come, or why they cannot."""

    def __init__(self) -> None:
        super().__init__()
        self.straight: Straight | None = None
        """By what the live picture is straightened now."""
        self._maps: Child | None = None
        self._depth = DEPTH

    @abstractmethod
    def calibration(self) -> Path | None:
        """The folder of the one by which the live picture is straightened."""

    @abstractmethod
    def picture_size(self) -> tuple[int, int] | None:
        """Width and height of the pictures, px, once one has come."""

    @abstractmethod
    def say(self, sentence: str, for_s: float = 0.0) -> None: ...

    @abstractmethod
    def show_straight(self) -> None:
        """`straight` has changed."""

    def action_straight(self) -> None:
        """The live picture undistorted, or as it is."""
        if self.straight or self._maps:
            self._use(None)
        else:
            self.app.push_screen(DepthScreen(f"{self._depth:g}"), self._make)

    def _make(self, depth: float | None) -> None:
        if depth is not None and (place := self.calibration()):
            self._depth = depth
            self._maps = Child(straighten, place, depth)
            self.say(f"The maps for {depth:g} m are being computed.", SAID_S)
            self._listen_to(self._maps)

    @work(thread=True, group="straighten", description="makes maps")
    def _listen_to(self, child: Child) -> None:
        for event in child.events():
            self.post_message(self.Straightened(child, event))

    @on(Straightened)
    def _straightened(self, message: Straightened) -> None:
        if message.child is not self._maps:
            return
        match message.event:
            case {"event": "result", "straight": Straight() as straight}:
                self._use(straight)
            case {"event": "error", "sentence": sentence}:
                self._use(None)
                self.say(sentence, SAID_S)

    def _use(self, straight: Straight | None) -> None:
        self._end_maps()
        size = self.picture_size()
        if straight and size and straight.size != size:
            wanted, given = (f"{wide}x{high}" for wide, high in (straight.size, size))
            self.say(
                f"The calibration is for {wanted} px and these pictures have {given}: choose the"
                " calibrated mode.",
                SAID_S,
            )
            straight = None
        self.straight = straight
        self.show_straight()

    def on_unmount(self) -> None:
        self._end_maps()

    def _end_maps(self) -> None:
        """Nobody waits for them any more."""
        if self._maps:
            self._maps.kill()
            self._maps = None
