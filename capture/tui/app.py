"""The terminal UI: from nothing to an exported map, following the screen.

Workers (threads, and processes behind them) post messages; handlers change the screen. The content
of a session is read from its folder, never remembered, so a lost connection costs nothing but the
view of it. A screen opens the next screens of the way. To return to an earlier one, it leaves, or
asks the app by a message.
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

from capture.process import prepare_processes
from capture.session_file import read_calibrated
from capture.tui.camera import Task
from capture.tui.check import CheckScreen
from capture.tui.check_source import CheckSourceScreen, playback_folder
from capture.tui.check_views import CheckViewsScreen, next_folder
from capture.tui.downloads import Download, find_downloads
from capture.tui.export import ExportScreen
from capture.tui.farewell import farewell_lines
from capture.tui.fit import FitScreen
from capture.tui.page import CorrectionRequested, Page, ToneRequested
from capture.tui.page_driver import PageDriver
from capture.tui.phone import PageRequest, Phone
from capture.tui.results import ResultsScreen
from capture.tui.setup import SetupScreen
from capture.tui.sized import is_too_small

# s, for which a thread that calculates may delay the screen: ten times less than usual
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
    """True if pictures are drawn in dots: the terminal has no greys, or the person wants
    them so.
    """
    on_phone: reactive[bool] = reactive(False)
    """True if a page for a thumb draws the app instead of a terminal."""

    def __init__(self, session: Path, source: str = "") -> None:
        """`source` may be empty: the set-up then proposes the first camera that it finds."""
        plain = "NO_COLOR" in os.environ
        super().__init__()
        prepare_processes()
        self.session = session
        self.source = source
        self._results_shown: ResultsScreen.ResultsOpened | None = None
        self._fit_screen: FitScreen | None = None
        self._maps: list[Path] = []
        self._phone: Phone | None = None
        self.set_reactive(CaptureApp.dots, plain or self.console.color_system in (None, "standard"))

    @property
    def farewell(self) -> Sequence[str]:
        """The lines for the terminal after the screen has gone."""
        results, was_cancelled = (
            self._results_shown,
            self._fit_screen is not None and self._fit_screen.was_cancelled,
        )
        if not results:
            return list(farewell_lines(self.session, None, self._maps, was_cancelled=was_cancelled))
        return list(
            farewell_lines(
                self.session,
                results.calibration,
                self._maps,
                depth=results.depth,
                boards=results.boards,
                doubt=results.doubt,
                has_black_border=results.has_black_border,
                was_cancelled=was_cancelled,
            )
        )

    def downloads(self) -> Sequence[Download]:
        """Return the files that the screen in front offers to a page: those of the results."""
        page = next(screen for screen in reversed(self.screen_stack) if isinstance(screen, Page))
        if not self._results_shown or page.step() != "Results":
            return ()
        screen = self.screen
        if isinstance(screen, ExportScreen) and (screen.is_writing or screen.is_invalid):
            return ()  # half of the files would be no export; earlier ones not what is asked for
        return list(find_downloads(self.session, self._results_shown.calibration, self._maps))

    def first_screen(self) -> Page:
        return SetupScreen(self.session, self.source)

    def on_mount(self) -> None:
        sys.setswitchinterval(SWITCH_S)
        cv2.setNumThreads(1)  # one of two cores stays free for the screen
        self.push_screen(self.first_screen())

    async def on_event(self, event: Event) -> None:
        """Ignore keys and pastes for a screen that the notice about a too small terminal hides."""
        if isinstance(event, Key | Paste) and is_too_small(self.screen):
            if isinstance(event, Key) and event.key == "q":
                self.exit()
            if not (isinstance(event, Key) and event.key == "ctrl+c"):
                return
        await super().on_event(event)

    @on(PageRequest)
    def _handle_request(self, message: PageRequest) -> None:
        if isinstance(self._driver, PageDriver):
            self._phone = self._phone or Phone(self, self._driver, self.downloads)
            self._phone.handle_request(message.request)
            self.on_phone = self._driver.muted

    @on(ToneRequested)
    def _send_tone(self, message: ToneRequested) -> None:
        if self._phone:
            self._phone.send_tone(message.tone)

    @on(ResultsScreen.RefitRequested)
    def _start_refit(self, message: ResultsScreen.RefitRequested) -> None:
        if self.screen is message.results:  # and no key has left it in the meantime
            self.switch_screen(FitScreen(message.results.session, message.results.result))

    @on(CorrectionRequested)
    def _correct(self, message: CorrectionRequested) -> None:
        """Go back to the set-up, to the field that is to be corrected."""
        set_up = next((page for page in self.screen_stack if isinstance(page, SetupScreen)), None)
        if set_up is None or self.screen is not message.page:
            return  # a key has left the page in the meantime
        set_up.correct(message.field, message.sentence)
        while self.screen is not set_up:
            self.pop_screen()

    @on(ResultsScreen.ResultsOpened)
    def _remember_results(self, message: ResultsScreen.ResultsOpened) -> None:
        self._results_shown = message

    @on(ResultsScreen.CheckRequested)
    def _check(self, message: ResultsScreen.CheckRequested) -> None:
        def start_check(source: str | None) -> None:
            if not source:
                return
            if pictures := playback_folder(source):
                self.push_screen(
                    CheckScreen(message.calibration, pictures, message.depth, message.boards)
                )
                return
            task = Task(
                next_folder(message.session),
                source,
                read_calibrated(message.calibration),
                bare=False,
            )
            self.push_screen(
                CheckViewsScreen(task, message.calibration, message.depth, message.boards)
            )

        self.push_screen(CheckSourceScreen(self.source), start_check)

    @on(FitScreen.FitStarted)
    def _remember_fit(self, message: FitScreen.FitStarted) -> None:
        self._fit_screen = message.screen

    @on(ExportScreen.MapsExported)
    def _show_export(self, message: ExportScreen.MapsExported) -> None:
        self._maps = list(dict.fromkeys([*message.written, *self._maps]))
        if message.screen is self.screen:
            message.screen.show_result(message)
        else:
            self.notify(message.sentence, markup=False)

    def action_interrupt(self) -> None:
        """End the program, as everywhere; in a browser the same keys copy."""
        if self.is_web:
            self.notify("To quit: q, or esc in the set-up.")
        else:
            self.exit()

    def action_dots(self) -> None:
        self.dots = not self.dots
