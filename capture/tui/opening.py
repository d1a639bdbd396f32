"""The screen that opens a finished session again: its results, without another fit."""

from pathlib import Path
from typing import ClassVar

from textual.binding import Binding

from capture.tui.child import Event
from capture.tui.fitting import open_results
from capture.tui.page import HELP_AND_QUIT
from capture.tui.results import ResultsScreen
from capture.tui.working_page import WorkingPage


class OpeningScreen(WorkingPage):
    BINDINGS: ClassVar = [
        Binding("o", "again", "Open again"),
        Binding("escape", "back", "Back", key_display="esc"),
        *HELP_AND_QUIT,
    ]
    RETRY_ADVICE = "Press o to try again, or esc to go back: ^r there fits the session anew."

    def __init__(self, session: Path, calibration: Path) -> None:
        """`calibration` is its folder."""
        super().__init__()
        self._session = session
        self._calibration = calibration

    def step(self) -> str:
        return "Results"

    def action_again(self) -> None:
        self.say("The results are being opened; esc cancels.")
        self.follow(open_results, self._calibration)

    def finished(self, result: Event) -> None:
        self.app.switch_screen(ResultsScreen(self._session, result, result.get("before")))

    def action_back(self) -> None:
        self.cancel()
        self.app.pop_screen()
