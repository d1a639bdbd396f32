"""The screen of the fit: it fits all views and shows how the error falls."""

from pathlib import Path
from typing import ClassVar

from textual.binding import Binding
from textual.message import Message

from calib.io.result_names import CALIBRATION_FILE
from capture.tui.child import Event
from capture.tui.corrected_fields import FIT_ANEW, in_form_words, list_labels, named_fields
from capture.tui.farewell import calibration_folder
from capture.tui.fitting import fit_session
from capture.tui.page import HELP_AND_QUIT, SET_UP
from capture.tui.results import ResultsScreen
from capture.tui.working_page import WorkingPage


class FitScreen(WorkingPage):
    BINDINGS: ClassVar = [
        Binding("f", "again", "Fit again"),
        SET_UP,
        Binding("escape", "back", "Back", key_display="esc"),
        *HELP_AND_QUIT,
    ]
    RETRY_ADVICE = "Press f to fit again, esc to go back."

    class FitStarted(Message):
        """The fit of the session has started on this screen."""

        def __init__(self, screen: "FitScreen") -> None:
            super().__init__()
            self.screen = screen

    def __init__(self, session: Path, previous: Event | None = None) -> None:
        """`previous` is the result of the fit before this one, to compare with."""
        super().__init__()
        self.session = session
        self._previous = previous
        self._start_time_ns = 0
        self.was_cancelled = False
        """True if the fit was cancelled before it wrote a result."""
        self._correction = "", ""
        """The field of the set-up that has to be corrected, if the fit has failed for that, and
        the sentence about it.
        """

    def step(self) -> str:
        return "Fit"

    def action_again(self) -> None:
        self.say("The views are being fitted. The camera rests; esc cancels.")
        self.was_cancelled = False
        self._correction = "", ""
        self._start_time_ns = self._modification_time_ns()
        self.app.post_message(self.FitStarted(self))  # at once: the next key may end the program
        self.follow(fit_session, self.session, self.session / "calibration")

    @property
    def correction(self) -> tuple[str, str]:
        return self._correction

    def show_failure(self, sentence: str, advice: str) -> None:
        """Show why the fit failed, and the field of the set-up that corrects it."""
        fields = named_fields(sentence)
        words = in_form_words(sentence)
        if fields:
            self._correction = fields[0], f"{words} {FIT_ANEW}"
            advice = f"Press s to correct {list_labels(fields)} in the set-up, esc to go back."
        self.say(f"{words} {advice}")
        self.refresh_bindings()

    def finished(self, result: Event) -> None:
        self.app.switch_screen(ResultsScreen(self.session, result, self._previous))

    def cancel(self) -> None:
        self.was_cancelled = self.was_cancelled or (
            self.child is not None and self._modification_time_ns() == self._start_time_ns
        )
        super().cancel()

    def _modification_time_ns(self) -> int:
        """Return the time of the session's calibration, ns; 0 where there is none."""
        folder = calibration_folder(self.session)
        return (folder / CALIBRATION_FILE).stat().st_mtime_ns if folder else 0

    def action_back(self) -> None:
        """Go back to the results before this fit, which are still those of the calibration."""
        self.cancel()
        if self._previous:
            self.app.switch_screen(
                ResultsScreen(self.session, self._previous, self._previous.get("before"))
            )
        else:
            self.app.pop_screen()
