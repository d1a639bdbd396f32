"""Effects: what the model lacks, found by `calib diagnose`, with the held-out error before and after."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import VerticalScroll
from textual.message import Message
from textual.screen import ModalScreen
from textual.widgets import Footer, Static

from calib.cli import COMMANDS
from capture.tui.command import Calib


def can_diagnose() -> bool:
    """Whether this version of calib has the command."""
    return any(command.__name__.endswith(".diagnose") for command in COMMANDS)


class EffectsScreen(ModalScreen[None]):
    DEFAULT_CSS = "EffectsScreen { background: $background; } EffectsScreen VerticalScroll { height: 1fr; padding: 1; }"
    BINDINGS: ClassVar = [Binding("escape", "dismiss", "Back", key_display="esc")]

    class Done(Message):
        """The command has ended."""

        def __init__(self, words: str) -> None:
            super().__init__()
            self.words = words

    def __init__(self, calibration: Path) -> None:
        super().__init__()
        self._calibration = calibration

    def compose(self) -> ComposeResult:
        with VerticalScroll():
            yield Static("Effects that the model lacks are being looked for. This takes some minutes; esc cancels.", markup=False)
        yield Footer(show_command_palette=False, compact=True)

    def on_mount(self) -> None:
        self._calib = Calib(["diagnose", str(self._calibration), "--json"])
        self._run()

    def on_unmount(self) -> None:
        self._calib.kill()

    @work(thread=True)
    def _run(self) -> None:
        done = self._calib.run()
        self.post_message(self.Done(told(json.loads(done.stdout)) if done.returncode == 0 else done.sentence))

    @on(Done)
    def _show(self, message: Done) -> None:
        self.query_one(Static).update(message.words)


def told(diagnosis: Mapping[str, Any]) -> str:
    """The diagnosis as a table."""
    before, after = diagnosis["before"], diagnosis["after"]
    found = ", ".join(diagnosis["accepted"]) or "none: nothing that was tried improves views that the fit has not seen"
    lines = [f"Effects found: {found}.", "", f"{'':<22}{'before':>10}{'after':>10}"]
    for key, words in (("rms_px", "error, px"), ("rmse_cm", "on the board, cm"), ("held_out_px", "on held-out views, px")):
        lines.append(f"{words:<22}{before[key]:>10.4f}{after[key]:>10.4f}")
    lines += ["", f"{'tried':<22}{'held out before':>16}{'after':>10}"]
    for one in diagnosis["candidates"]:
        if one["held_out_px_after"] is not None:
            lines.append(f"{one['effect']:<22}{one['held_out_px_before']:>13.4f} px{one['held_out_px_after']:>7.4f} px")
    return "\n".join(lines)
