"""The screen of the fit: every view that there is is fitted, and one sees how the error falls."""

from pathlib import Path
from typing import ClassVar

from textual.binding import Binding

from capture.tui.child import Event
from capture.tui.fitting import fit_session
from capture.tui.page import HELP_AND_QUIT
from capture.tui.results import ResultsScreen
from capture.tui.working import WorkingPage


class FitScreen(WorkingPage):
    BINDINGS: ClassVar = [
        Binding("f", "again", "Fit again"),
        Binding("escape", "back", "Cancel, back", key_display="esc"),
        *HELP_AND_QUIT,
    ]
    AGAIN = "Press f to fit again, esc to go back."

    def __init__(self, session: Path, before: Event | None = None) -> None:
        """`before`: the result of the fit before this one, to compare with."""
        super().__init__()
        self.session = session
        self._before = before

    def step(self) -> str:
        return "Fit"

    def action_again(self) -> None:
        self.say("The views are being fitted. The camera rests; esc cancels.")
        self.follow(fit_session, self.session, self.session / "calibration")

    def finished(self, result: Event) -> None:
        self.app.switch_screen(ResultsScreen(self.session, result, self._before))

    def action_back(self) -> None:
        self.cancel()
        self.app.pop_screen()
