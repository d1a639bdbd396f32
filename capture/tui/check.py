"""Check: the screen that tests whether a calibration still holds for later pictures, as `calib
check` does.
"""

from pathlib import Path
from typing import ClassVar

from textual.binding import Binding

from calib.errors import harmless
from capture.tui.answer_page import SCROLL, AnswerPage
from capture.tui.checking import check_calibration
from capture.tui.child import Event
from capture.tui.export import ExportScreen
from capture.tui.page import HELP_AND_QUIT

NEXT_STEPS = {
    "valid": "You need not do anything: esc goes back.",
    "degraded": (
        "Press enter to bring the calibration up to date by these pictures, or esc to go back and"
        " record anew."
    ),
    "broken": (
        "Press enter to try to bring the calibration up to date by these pictures, or esc to go"
        " back and record anew."
    ),
    "": (
        "With these pictures it cannot be brought up to date: esc goes back, to take others, or to"
        " record the session anew."
    ),
    "known": "Such pictures say nothing about today: press esc, then c, to name others.",
}


class CheckScreen(AnswerPage):
    PART = "check"
    DEFAULT_CSS = "CheckScreen #sentence { height: auto; min-height: 3; max-height: 6; }"
    BINDINGS: ClassVar = [
        Binding("enter", "update", "Bring up to date", key_display="enter"),
        Binding("x", "export", "Export maps"),
        Binding("c", "again", "Check again"),
        *SCROLL,
        Binding("escape", "back", "Back", key_display="esc"),
        *HELP_AND_QUIT,
    ]
    RETRY_ADVICE = "Press c to check the same pictures again, esc to go back and name others."

    def __init__(
        self,
        calibration: Path,
        pictures: Path,
        depth: float,
        boards: tuple[float, float] | None = None,
    ) -> None:
        """`calibration` is the file of the calibration.

        `pictures` is a session, or a folder of pictures. `depth` and `boards` are those of
        `ExportScreen`.
        """
        super().__init__()
        self._boards = boards
        self._depth = depth
        self._calibration = calibration
        self._pictures = pictures

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        match action:
            case "update":
                return self._may_update and self.child is None
            case "export":
                return bool(self.result.get("written"))
        return super().check_action(action, parameters)

    def action_again(self) -> None:
        self.say("The calibration is being checked; esc cancels.")
        self.follow(check_calibration, self._calibration, self._pictures)

    def action_update(self) -> None:
        self.say("The calibration is being brought up to date; esc cancels.")
        self.result = {}
        self.follow(
            check_calibration,
            self._calibration,
            self._pictures,
            self._calibration.parent / "updated",
        )

    def finished(self, result: Event) -> None:
        super().finished(result)
        written = (
            f"Up to date: {result['written']}. Press x to export maps of it; the one before it"
            " stays as it was."
        )
        key = "known" if result["known"] else result["word"]
        next_step = NEXT_STEPS[key if self._may_update or key in ("valid", "known") else ""]
        self.say(harmless(written if result["written"] else f"{result['sentence']} {next_step}"))

    @property
    def _may_update(self) -> bool:
        return (
            bool(self.result)
            and self.result["word"] != "valid"
            and self.result["usable"]
            and not self.result["written"]
        )

    def action_export(self) -> None:
        updated = Path(self.result["written"])
        screen = ExportScreen(updated.parent, updated, self._depth, self._boards)
        self.app.push_screen(screen, lambda wrote: self.say(wrote) if wrote else None)

    def action_back(self) -> None:
        self.cancel()
        self.app.pop_screen()
