"""The screen of the fit: every view that there is is fitted, and one sees how the error falls."""

from pathlib import Path
from typing import ClassVar

from textual.binding import Binding
from textual.message import Message

from capture.tui.child import Event
from capture.tui.farewell import CALIBRATION, fitted
from capture.tui.fitting import fit_session
from capture.tui.page import HELP_AND_QUIT
from capture.tui.results import ResultsScreen
from capture.tui.working_page import WorkingPage


class FitScreen(WorkingPage):
    BINDINGS: ClassVar = [
        Binding("f", "again", "Fit again"),
        Binding("escape", "back", "Cancel, back", key_display="esc"),
        *HELP_AND_QUIT,
    ]
    AGAIN = "Press f to fit again, esc to go back."

    class Began(Message):
        """This screen fits the session from now on."""

        def __init__(self, screen: "FitScreen") -> None:
            super().__init__()
            self.screen = screen

    def __init__(self, session: Path, before: Event | None = None) -> None:
        """`before`: the result of the fit before this one, to compare with."""
        super().__init__()
        self.session = session
        self._before = before
        self._stamp = 0
        self.cut_short = False
        """The fit was cancelled, and has left nothing."""

    def step(self) -> str:
        return "Fit"

    def action_again(self) -> None:
        self.say("The views are being fitted. The camera rests; esc cancels.")
        self.cut_short = False
        self._stamp = self._written()
        self.app.post_message(self.Began(self))  # at once: a key may end the program next
        self.follow(fit_session, self.session, self.session / "calibration")

    def finished(self, result: Event) -> None:
        self.app.switch_screen(ResultsScreen(self.session, result, self._before))

    def cancel(self) -> None:
        self.cut_short = self.cut_short or (
            self.child is not None and self._written() == self._stamp
        )
        super().cancel()

    def _written(self) -> int:
        """When the session's calibration was, ns; 0 where there is none."""
        folder = fitted(self.session)
        return (folder / CALIBRATION).stat().st_mtime_ns if folder else 0

    def action_back(self) -> None:
        """To the results that a fit was to follow, which are still those of the calibration."""
        self.cancel()
        if self._before:
            self.app.switch_screen(
                ResultsScreen(self.session, self._before, self._before.get("before"))
            )
        else:
            self.app.pop_screen()
