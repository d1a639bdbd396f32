"""The terminal UI: from nothing to an exported map, following the screen.

Workers (threads, and processes behind them) post messages; handlers change the screen. What a
session holds is read from its folder, never remembered, so a lost connection costs nothing but the
view of it. A screen opens those that come after it on the way; to go back to an earlier one, it
leaves, or asks the app by a message.
"""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import ClassVar

import cv2
from textual import on
from textual.app import App
from textual.binding import Binding
from textual.events import Event, Key, Paste
from textual.reactive import reactive

from capture.process import prepare
from capture.session_file import read_calibrated
from capture.tui.camera import Task
from capture.tui.check import CheckScreen
from capture.tui.check_source import CheckSourceScreen, folder_of
from capture.tui.check_views import CheckViewsScreen, next_folder
from capture.tui.collect import CollectScreen
from capture.tui.export import ExportScreen
from capture.tui.farewell import farewell
from capture.tui.fit import FitScreen
from capture.tui.page import Page
from capture.tui.page_driver import PageDriver
from capture.tui.phone import Asked, Phone
from capture.tui.results import ResultsScreen
from capture.tui.setup import SetupScreen

# for which a thread that calculates may keep the screen waiting, ten times less than usual
SWITCH_S = 0.0005


class CaptureApp(App[None]):
    TITLE = "Refracal"
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    * { scrollbar-size: 1 1; }
    Input, Footer { scrollbar-size: 0 0; }
    Screen *:nocolor:focus { text-style: reverse; }
    OptionList:nocolor:focus { text-style: none; }
    .banner { width: 1fr; text-style: bold; padding: 0 1; }
    """
    BINDINGS: ClassVar = [Binding("ctrl+c", "interrupt", show=False, priority=True)]
    NOTIFICATION_TIMEOUT: ClassVar = 4.0
    dots: reactive[bool] = reactive(False)
    """Pictures in dots: the terminal has no greys, or the person wants them so."""
    on_phone: reactive[bool] = reactive(False)
    """A page for a thumb draws the app, and no terminal."""

    def __init__(self, session: Path, source: str = "") -> None:
        """`source` may be empty: the set-up then names the first camera that it finds."""
        plain = "NO_COLOR" in os.environ
        super().__init__()
        prepare()
        self.session = session
        self.source = source
        self._shown: ResultsScreen.Opened | None = None
        self._fit: FitScreen | None = None
        self._maps: list[Path] = []
        self._phone: Phone | None = None
        self.set_reactive(CaptureApp.dots, plain or self.console.color_system in (None, "standard"))

    @property
    def farewell(self) -> Sequence[str]:
        """Lines for the terminal, when the screen has gone."""
        shown, cut_short = self._shown, self._fit is not None and self._fit.cut_short
        if not shown:
            return list(farewell(self.session, None, self._maps, cut_short=cut_short))
        return list(
            farewell(
                self.session,
                shown.calibration,
                self._maps,
                depth=shown.depth,
                doubt=shown.doubt,
                cut_short=cut_short,
            )
        )

    def on_mount(self) -> None:
        sys.setswitchinterval(SWITCH_S)
        cv2.setNumThreads(1)  # of two cores, one stays for the screen
        self.push_screen(SetupScreen(self.session, self.source))

    async def on_event(self, event: Event) -> None:
        """What is hidden by the notice that the terminal is too small obeys no key, and nothing is
        typed into it.
        """
        if isinstance(event, Key | Paste) and isinstance(self.screen, Page) and self.screen.small:
            if isinstance(event, Key) and event.key == "q":
                self.exit()
            if not (isinstance(event, Key) and event.key == "ctrl+c"):
                return
        await super().on_event(event)

    @on(Asked)
    def _asked(self, message: Asked) -> None:
        if isinstance(self._driver, PageDriver):
            self._phone = self._phone or Phone(self, self._driver)
            self._phone.obey(message.what)
            self.on_phone = self._driver.muted

    @on(CollectScreen.Heard)
    def _heard(self, message: CollectScreen.Heard) -> None:
        if self._phone:
            self._phone.hear(message.tone)

    @on(ResultsScreen.FitAgain)
    def _fit_again(self, message: ResultsScreen.FitAgain) -> None:
        if self.screen is message.results:  # and not left by a key that was pressed just after
            self.switch_screen(FitScreen(message.results.session, message.results.result))

    @on(ResultsScreen.Opened)
    def _opened(self, message: ResultsScreen.Opened) -> None:
        self._shown = message

    @on(ResultsScreen.Doubted)
    def _check(self, message: ResultsScreen.Doubted) -> None:
        def begin(source: str | None) -> None:
            if not source:
                return
            if pictures := folder_of(source):
                self.push_screen(CheckScreen(message.calibration, pictures, message.depth))
                return
            task = Task(
                next_folder(message.session),
                source,
                read_calibrated(message.calibration),
                bare=False,
            )
            self.push_screen(CheckViewsScreen(task, message.calibration, message.depth))

        self.push_screen(CheckSourceScreen(self.source), begin)

    @on(FitScreen.Began)
    def _began(self, message: FitScreen.Began) -> None:
        self._fit = message.screen

    @on(ExportScreen.Done)
    def _exported(self, message: ExportScreen.Done) -> None:
        self._maps = list(message.written) or self._maps
        if message.screen is self.screen:
            message.screen.tell(message)
        else:
            self.notify(message.sentence, markup=False)

    def action_interrupt(self) -> None:
        """Ends the program, as everywhere; in a browser the same keys copy."""
        if self.is_web:
            self.notify("To quit: q, or esc in the set-up.")
        else:
            self.exit()

    def action_dots(self) -> None:
        self.dots = not self.dots
