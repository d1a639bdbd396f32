"""Taking the few pictures that a calibration is checked with: the collecting screen, for a folder
of their own and another end.
"""

from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from textual.binding import Binding

from capture.coverage import Hint, SessionProgress
from capture.tui.camera import Task
from capture.tui.check import CheckScreen
from capture.tui.collect import LACKING_S, CollectScreen

FEWEST, ENOUGH = 3, 5
"""Views that a check takes, and from which on more tell little."""
CHECKS = "checks"
"""The folder in a session that holds the pictures of its checks, a session each."""


def next_folder(session: Path) -> Path:
    """Where the next check's pictures go: checks/001 and so on."""
    taken = [int(each.name) for each in (session / CHECKS).glob("[0-9]*") if each.name.isdecimal()]
    return session / CHECKS / f"{max(taken, default=0) + 1:03d}"


class CheckViewsScreen(CollectScreen):
    PART = "check"
    BINDINGS: ClassVar = [
        Binding("f", "fit", "Check"),
        Binding("f", "not_yet", show=False),
        Binding("escape", "back", "Results", key_display="esc"),
    ]
    MAPS: ClassVar = False

    def __init__(self, task: Task, calibration: Path, depth: float) -> None:
        """`task` records into a session of its own.

        `calibration`: the file of what is checked. `depth` as CheckScreen has it.
        """
        super().__init__(task)
        self._depth = depth
        self._calibration = calibration

    def step(self) -> str:
        return "Results"

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        match action:
            case "cover_on" | "none_yet" | "results":
                return False
            case "fit":
                return len(self.kept) >= FEWEST
        return super().check_action(action, parameters)

    def ending(self, message: CollectScreen.Stopped) -> str:
        if message.again or not self.kept:
            return super().ending(message)
        onward = "f to check, " if len(self.kept) >= FEWEST else ""
        return f"{message.sentence} Press {onward}o to {message.anew}, esc for the results."

    def told(self, progress: SessionProgress) -> SessionProgress:
        return replace(
            progress,
            sentence=f"A check takes {FEWEST} views, tilted, near and far; {ENOUGH} are enough.",
        )

    def enough(self, progress: SessionProgress | None) -> bool:
        del progress
        return len(self.kept) >= ENOUGH

    def point(self, hint: Hint | None, progress: SessionProgress | None) -> None:
        """As wide apart as in a session: a tilted board, near and far, tells most."""
        super().point(hint, progress)
        self.refresh_bindings()

    def onward(self) -> str:
        return "press f to check"

    def calibration(self) -> Path:
        return self._calibration.parent

    def action_fit(self) -> None:
        self.rest()
        self.app.switch_screen(CheckScreen(self._calibration, self.plan.folder, self._depth))

    def action_not_yet(self) -> None:
        self.say(
            f"A check takes {FEWEST} views at the least, of a tilted board, near and far.",
            LACKING_S,
        )
