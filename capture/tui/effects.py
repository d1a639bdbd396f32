"""Effects: the screen that searches for missing effects as `calib diagnose` does, and shows the
error with and without them; the person then goes on with them, or without.
"""

from pathlib import Path
from typing import ClassVar

from textual.binding import Binding

from capture.tui.answer_page import SCROLL, AnswerPage
from capture.tui.child import Event
from capture.tui.diagnosing import diagnose_calibration
from capture.tui.page import HELP_AND_QUIT, SET_UP


class EffectsScreen(AnswerPage):
    """A page that is dismissed with True if the person wants to use the effects; `result` then
    holds the new calibration.
    """

    PART = "effects"
    BINDINGS: ClassVar = [
        Binding("enter", "use", "Use them", key_display="enter"),
        Binding("e", "again", "Look again"),
        *SCROLL,
        SET_UP,
        Binding("escape", "back", "Back", key_display="esc"),
        *HELP_AND_QUIT,
    ]
    RETRY_ADVICE = "Press e to look again, esc to go back."

    def __init__(self, calibration: Path) -> None:
        super().__init__()
        self._calibration = calibration

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        if action == "use":
            return bool(self.result.get("accepted"))
        return super().check_action(action, parameters)

    def action_again(self) -> None:
        self.say(
            "The search for effects that the model lacks is running. It takes a few minutes at"
            " most; esc cancels."
        )
        self.follow(diagnose_calibration, self._calibration, self._calibration.parent / "diagnosed")

    def finished(self, result: Event) -> None:
        super().finished(result)
        effects = " and ".join(result["accepted"])
        use = (
            f"Press enter to go on with {effects}, and to export maps with it; esc leaves the fit"
            " as it was."
        )
        self.say(
            use
            if effects
            else "Nothing is added: the fit stays as it was. Press esc, then x to export maps."
        )

    def action_use(self) -> None:
        self.dismiss(True)

    def action_back(self) -> None:
        self.dismiss(False)
