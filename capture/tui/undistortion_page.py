"""A page whose live picture can be shown undistorted: its action asks for a depth, a process makes
the maps, and another action with the same key ends it.
"""

from abc import abstractmethod
from pathlib import Path

from textual import on, work

from capture.tui.child import Child
from capture.tui.depth import DepthScreen
from capture.tui.farewell import propose_depth
from capture.tui.live_undistortion import LiveUndistortion, make_undistortion
from capture.tui.page import ChildReported, Page

MESSAGE_S = 6.0  # s for which a message about the maps stays
SHORT_MESSAGE_S = 2.0  # s, for one that the picture confirms


class UndistortionPage(Page):
    class UndistortionReported(ChildReported):
        """The maps have come, or the reason why they cannot."""

    def __init__(self) -> None:
        super().__init__()
        self.undistortion: LiveUndistortion | None = None
        """The present undistortion of the live picture; None: it is shown as it is."""
        self._maps: Child | None = None
        self._depth: float | None = None
        """m, the last depth that the person has chosen."""

    @abstractmethod
    def calibration(self) -> Path | None:
        """Return the folder of the calibration that undistorts the live picture; None if there is
        none.
        """

    @abstractmethod
    def picture_size(self) -> tuple[int, int] | None:
        """Return width and height of the pictures, px; None before the first one."""

    @abstractmethod
    def say(self, sentence: str, for_s: float = 0.0) -> None: ...

    @abstractmethod
    def show_undistortion(self) -> None:
        """Show the picture after `undistortion` has changed."""

    @property
    def is_making_maps(self) -> bool:
        return self._maps is not None

    @property
    def is_undistorting(self) -> bool:
        """True if the live picture is shown undistorted, or will be once its maps have come."""
        return self.undistortion is not None or self.is_making_maps

    def action_straight(self) -> None:
        """Show the live picture undistorted."""
        if place := self.calibration():
            depth = self._depth or propose_depth(place)
            self.app.push_screen(DepthScreen(f"{depth:g}"), self._make)

    def action_as_it_is(self) -> None:
        """Show the live picture as the camera takes it."""
        self._use(None)
        self.say("The picture is shown as it is.", SHORT_MESSAGE_S)

    def _make(self, depth: float | None) -> None:
        if depth is not None and (place := self.calibration()):
            self._depth = depth
            self._maps = Child(make_undistortion, place, depth)
            self.say(f"The maps for {depth:g} m are being computed.", MESSAGE_S)
            self.refresh_bindings()
            self._listen_to(self._maps)

    @work(thread=True, group="straighten", description="makes maps")
    def _listen_to(self, child: Child) -> None:
        for event in child.events():
            self.post_message(self.UndistortionReported(child, event))

    @on(UndistortionReported)
    def _handle_event(self, message: UndistortionReported) -> None:
        if message.child is not self._maps:
            return
        match message.event:
            case {"event": "result", "straight": LiveUndistortion() as undistortion}:
                self._use(undistortion)
            case {"event": "error", "sentence": sentence}:
                self._use(None)
                self.say(sentence, MESSAGE_S)

    def _use(self, undistortion: LiveUndistortion | None) -> None:
        self._end_maps()
        size = self.picture_size()
        if undistortion and size and undistortion.size != size:
            calibrated = "x".join(map(str, undistortion.size))
            present = "x".join(map(str, size))
            self.say(
                f"The calibration is for {calibrated} px and these pictures have {present}: choose"
                " the calibrated mode.",
                MESSAGE_S,
            )
            undistortion = None
        elif undistortion:
            self.say(f"Undistorted for {undistortion.depth:g} m.", MESSAGE_S)
        self.undistortion = undistortion
        self.refresh_bindings()
        self.show_undistortion()

    def on_unmount(self) -> None:
        self._end_maps()

    def _end_maps(self) -> None:
        """Stop the process: nobody needs its maps any more."""
        if self._maps:
            self._maps.kill()
            self._maps = None
