"""The screen that takes the few pictures of a check: the collecting screen, with a separate folder
and another next step.
"""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from textual.binding import Binding

from capture.coverage import Hint, SessionProgress
from capture.tui.camera import Task
from capture.tui.check import CheckScreen
from capture.tui.collect import REASON_S, CollectScreen

MIN_CHECK_VIEWS, ENOUGH_CHECK_VIEWS = 3, 5
"""The views that a check needs, and the number above which more views help little."""
CHECKS = "checks"
"""The folder in a session that holds the pictures of its checks, each as a session."""


def next_folder(session: Path) -> Path:
    """Return the folder for the next check's pictures: checks/001 and so on."""
    numbers = [
        int(folder.name) for folder in (session / CHECKS).glob("[0-9]*") if folder.name.isdecimal()
    ]
    return session / CHECKS / f"{max(numbers, default=0) + 1:03d}"


class CheckViewsScreen(CollectScreen):
    PART = "check"
    BINDINGS: ClassVar = [
        Binding("f", "fit", "Check"),
        Binding("f", "not_yet", show=False),
        Binding("escape", "back", "Results", key_display="esc"),
    ]
    MAPS: ClassVar = False
    CORRECT_BOARD: ClassVar = "show the board that was calibrated with"
    CORRECT_SIZE: ClassVar = "Show the board that was calibrated with: esc for the results."

    def __init__(
        self,
        task: Task,
        calibration: Path,
        depth: float,
        boards: tuple[float, float] | None = None,
    ) -> None:
        """`task` records into a separate session.

        `calibration` is the file of the checked calibration. `depth` and `boards` are as in
        CheckScreen.
        """
        super().__init__(task)
        self._boards = boards
        self._map_depth = depth
        self._calibration = calibration

    def step(self) -> str:
        return "Results"

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        match action:
            case "cover_on" | "none_yet" | "results":
                return False
            case "fit":
                return len(self.view_corners) >= MIN_CHECK_VIEWS
        return super().check_action(action, parameters)

    def ending_sentence(self, message: CollectScreen.RecordingStopped) -> str:
        if message.retries or not self.view_corners:
            return super().ending_sentence(message)
        next_step_text = "f to check, " if len(self.view_corners) >= MIN_CHECK_VIEWS else ""
        return (
            f"{message.sentence} Press {next_step_text}o to {message.restart_text}, esc for the"
            " results."
        )

    def adapt_progress(self, progress: SessionProgress) -> SessionProgress:
        return replace(
            progress,
            sentence=(
                f"A check takes {MIN_CHECK_VIEWS} views, tilted, near and far;"
                f" {ENOUGH_CHECK_VIEWS} are enough."
            ),
        )

    def is_enough(self, progress: SessionProgress | None) -> bool:
        del progress
        return len(self.view_corners) >= ENOUGH_CHECK_VIEWS

    def show_hint(self, hint: Hint | None, progress: SessionProgress | None) -> None:
        """Show the hint; the views should differ as in a session: a tilted board, near and far,
        helps most.
        """
        super().show_hint(hint, progress)
        self.refresh_bindings()

    def next_step_text(self) -> str:
        return "press f to check"

    @property
    def correction(self) -> tuple[str, str]:
        """None: the board is that of the calibration."""
        return "", ""

    def calibration(self) -> Path:
        return self._calibration.parent

    def action_fit(self) -> None:
        self.stop_recording()
        self.app.switch_screen(
            CheckScreen(self._calibration, self.plan.folder, self._map_depth, self._boards)
        )

    def action_not_yet(self) -> None:
        self.say(
            f"A check takes {MIN_CHECK_VIEWS} views at the least, of a tilted board, near and far.",
            REASON_S,
        )
