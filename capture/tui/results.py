"""Results: the screen with the error before and after, the views from the worst on, and the next
steps.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.events import Resize, ScreenResume
from textual.message import Message
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from calib.corners.detect import eight_bits
from calib.errors import RefracalError, harmless
from calib.io.images import frames_folder, read_grey
from calib.io.result_names import CALIBRATION_FILE
from calib.session.shapes.layer import AIR
from capture.tui.camera import Preview
from capture.tui.cells import CORNER_MARK, WORST_MARK, Mark
from capture.tui.child import Event
from capture.tui.command import calib
from capture.tui.downloads import OPEN_REPORT
from capture.tui.drop import (
    DroppedPicture,
    drop_picture,
    find_dropped,
    find_dropped_earlier,
    restore_picture,
)
from capture.tui.effects import EffectsScreen
from capture.tui.export import ExportScreen
from capture.tui.farewell import updated_folder
from capture.tui.numbers import Numbers
from capture.tui.page import HELP_AND_QUIT, SET_UP, Page
from capture.tui.picture import Picture
from capture.tui.results_text import ResultsText

ROOMY = (110, 36)  # the columns and rows from which the screen has room for the numbers as well
NUMBERS_NOTE = "n: camera and cover"
EARLIER_FIT_NOTE = (
    "Views were set aside since this fit: these maps are still of the fit with them. esc, then f,"
    " fits without them."
)


class ResultsScreen(Page):
    DEFAULT_CSS = """
    ResultsScreen #top { height: 1fr; }
    ResultsScreen #left { width: 48; padding: 0 1; }
    ResultsScreen #stages { height: auto; }
    ResultsScreen #title { height: 1; text-style: bold; margin: 1 0 0 0; }
    ResultsScreen OptionList { height: 1fr; border: none; padding: 0; }
    ResultsScreen #right { width: 1fr; }
    ResultsScreen Picture { height: 1fr; }
    ResultsScreen #view { height: 2; }
    ResultsScreen #verdict { height: auto; }
    ResultsScreen #verdict.trusted { color: $text-success; }
    ResultsScreen #verdict.care { color: $text-warning; }
    ResultsScreen #verdict.do_not_use { color: $text-error; }
    ResultsScreen #said { height: auto; }
    ResultsScreen #sentence { height: auto; min-height: 2; max-height: 8; }
    ResultsScreen #onward { height: auto; }
    """
    BINDINGS: ClassVar = [
        Binding("d", "drop", "Drop"),
        Binding("z", "take_back", "Undo"),
        Binding("f", "refit", "Fit"),
        Binding("f", "refit_unseen", show=False),
        Binding("e", "effects", "Diagnose"),
        Binding("c", "check", "Check"),
        Binding("c", "check_unseen", show=False),
        SET_UP,
        Binding("r", "report", "Report"),
        Binding("x", "export", "Export"),
        # shown keys would make the line too long
        Binding("m", "app.dots", show=False),
        Binding("n", "numbers", show=False),
        Binding("escape", "back", "Back", key_display="esc"),
        *HELP_AND_QUIT,
    ]

    class PictureLoaded(Message):
        """A view's picture was read."""

        def __init__(self, view: Mapping[str, Any], preview: Preview | None) -> None:
            super().__init__()
            self.view = view
            self.preview = preview

    class ResultsOpened(Message):
        """The results of this calibration are shown."""

        def __init__(
            self,
            calibration: Path,
            depth: float,
            boards: tuple[float, float] | None,
            doubt: str,
            *,
            has_black_border: bool,
        ) -> None:
            super().__init__()
            self.has_black_border = has_black_border
            """True if straight pictures have a black border unless it is cropped."""
            self.calibration = calibration
            self.depth = depth
            """m, the proposed depth of maps."""
            self.boards = boards
            """m, the depths of the nearest and the farthest corners, if they are known."""
            self.doubt = doubt
            """The verdict's first sentence, if the calibration is not trusted."""

    class ReportWritten(Message):
        """The command for the report has ended."""

        def __init__(self, sentence: str) -> None:
            super().__init__()
            self.sentence = sentence

    class RefitRequested(Message):
        """The person wants a new fit, because the views have changed."""

        def __init__(self, results: "ResultsScreen") -> None:
            super().__init__()
            self.results = results

    class CheckRequested(Message):
        """The person wants to check whether this calibration still holds."""

        def __init__(
            self,
            session: Path,
            calibration: Path,
            depth: float,
            boards: tuple[float, float] | None,
        ) -> None:
            super().__init__()
            self.session = session
            self.calibration = calibration
            """The calibration's file."""
            self.depth = depth
            """m, the proposed depth of maps."""
            self.boards = boards
            """m, the distances of the nearest and of the farthest board."""

    def __init__(self, session: Path, result: Event, previous: Event | None = None) -> None:
        """`result` is as `fit_session` gives it; `previous` is that of the fit before, to compare
        with.
        """
        super().__init__()
        self.session = session
        self.result = {**result, "before": {"stages": previous["stages"]}} if previous else result
        """The result, with the stages that it is compared with."""
        # a diagnosis continues the fit itself, so the comparison would repeat the same numbers
        previous_stages = previous["stages"] if previous else []
        diagnosed = (
            len(result["stages"]) > len(previous_stages)
            and result["stages"][: len(previous_stages)] == previous_stages
        )
        self._text = ResultsText(self.result, None if diagnosed else previous)
        files = [view["file"] for view in result["views"]]
        self._numbers_wanted = False
        """True if the numbers replace the views where there is no room for both."""
        self._view_line = ""
        """What is said of the view that is shown."""
        self._update_shown = bool(self._text.update_note())
        """True if the screen says that a check has updated the calibration."""
        self._dropped: list[DroppedPicture] = find_dropped(session, files)
        self._dropped_earlier = find_dropped_earlier(
            session, [*files, *(picture.path.name for picture in self._dropped)]
        )
        """The pictures that this fit went on without, the last one last."""
        self._taken_back = False
        """True once one of these is back."""
        self._is_faultless = False
        """True if a diagnosis has found nothing."""

    def step(self) -> str:
        return "Results"

    @property
    def early_actions(self) -> frozenset[str]:
        """After a view was set aside or taken back, a fit comes first; of a calibration that must
        not be used, the report, which says why.
        """
        if self._has_changed:
            return frozenset({"export"})
        return frozenset({"export", "refit"} if self._text.is_forbidden else ())

    @property
    def _has_changed(self) -> bool:
        """True if views were set aside or taken back since the fit."""
        return bool(self._dropped) or self._taken_back

    @property
    def _has_aside(self) -> bool:
        """True if there are views to take back."""
        return bool(self._dropped or self._dropped_earlier)

    @property
    def correction(self) -> tuple[str, str]:
        text = self._text
        return (text.fields[0], text.correction) if text.fields else ("", "")

    def body(self) -> ComposeResult:
        with Horizontal(id="top"):
            with Vertical(id="left"):
                yield Static(self._text.stages, id="stages", markup=False)
                yield Static("Views, the worst first", id="title", markup=False)
                yield OptionList(
                    *(Option(self._line(view), id=view["file"]) for view in self.result["views"]),
                    markup=False,
                    compact=True,
                )
            with Vertical(id="right"):
                yield Picture()
                yield Static(id="view", markup=False)
        yield Numbers(self.result)
        word = self.result["verdict"]["word"]
        yield Static(self._text.headline, id="verdict", classes=f"banner {word}", markup=False)
        said = Static(id="said", classes="banner", markup=False)
        said.display = False
        yield said
        details = map(harmless, self._text.details(len(self._dropped)))
        separator = "\n" if self._on_phone else " "
        yield Static(separator.join(details), id="sentence", classes="banner", markup=False)
        yield Static(self._next_steps, id="onward", classes="banner", markup=False)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        del parameters
        shown = {
            "check": not self._text.fields and (self._has_room or not self._has_aside),
            "refit": self._has_room or self._has_changed,
            # None: off, in its place
            "take_back": self._has_aside or (None if self._on_phone else False),
        }
        shown["check_unseen"] = not (shown["check"] or self._text.fields)
        shown["refit_unseen"] = not shown["refit"]
        return shown.get(action, True)

    def on_mount(self) -> None:
        self.query_one(OptionList).focus()
        self.watch(self.app, "on_phone", self._arrange)
        text = self._text
        doubt = "" if text.is_trusted else text.headline
        self.post_message(
            self.ResultsOpened(
                text.calibration,
                text.depth,
                text.boards,
                doubt,
                has_black_border=text.has_black_border,
            )
        )

    @on(Resize)
    def _arrange(self) -> None:
        """Show views and numbers, or one of the two where there is no room for both. A phone's page
        scrolls.
        """
        is_roomy = self._has_room
        self.refresh_bindings()
        numbers = self.query_one(Numbers)
        numbers.lay_out(narrow=not is_roomy)
        numbers.display = is_roomy or self._numbers_wanted
        self.query_one("#top").display = is_roomy or not self._numbers_wanted
        has_details = self._on_phone or not self.query_one("#said").display
        self.query_one("#sentence").display = has_details
        self._describe_view()

    @property
    def _on_phone(self) -> bool:
        return bool(getattr(self.app, "on_phone", False))

    @property
    def _has_room(self) -> bool:
        return self._on_phone or (self.size.width >= ROOMY[0] and self.size.height >= ROOMY[1])

    def action_numbers(self) -> None:
        """Show the numbers in place of the views, or the views again."""
        self._numbers_wanted = not self._numbers_wanted
        self._arrange()
        if self.query_one("#top").display:
            self.query_one(OptionList).focus()

    @property
    def _next_steps(self) -> str:
        return self._text.next_steps(is_faultless=self._is_faultless)

    def _line(self, view: Mapping[str, Any]) -> str:
        is_dropped = any(picture.file == view["file"] for picture in self._dropped)
        return self._text.view_line(view, is_dropped=is_dropped)

    @on(OptionList.OptionHighlighted)
    def _show(self, event: OptionList.OptionHighlighted) -> None:
        view = self.result["views"][event.option_index]
        self._load(view, self.query_one(Picture).phone)

    @work(thread=True, exclusive=True, group="picture", description="reads a picture")
    def _load(self, view: Mapping[str, Any], sharp: bool) -> None:
        try:
            preview = Preview.of(
                eight_bits(read_grey(self._picture_path(view["file"]))), sharp=sharp
            )
        except RefracalError:
            preview = None
        self.post_message(self.PictureLoaded(view, preview))

    def _picture_path(self, file: str) -> Path:
        return next(
            (picture.path for picture in self._dropped if picture.file == file),
            frames_folder(self.session) / file,
        )

    @on(PictureLoaded)
    def _show_picture(self, message: PictureLoaded) -> None:
        view = message.view
        corners, errors = np.array(view["corners"]), np.array(view["errors"])
        sizes = np.linalg.norm(errors, axis=-1)
        worst = int(np.nanargmax(sizes))
        self.query_one(Picture).show(
            message.preview, [Mark(CORNER_MARK, corners), Mark(WORST_MARK, corners[[worst]])]
        )
        words = f"{CORNER_MARK} corners  {WORST_MARK} worst: {sizes[worst]:.2f} px off"
        if self._on_phone:
            words = f"{harmless(view['file'])}. Red: its worst corner, {sizes[worst]:.2f} px off"
        self._view_line = words if message.preview else "This picture cannot be read any more."
        self._describe_view()

    def _describe_view(self) -> None:
        note = "" if self._has_room else f"\n{NUMBERS_NOTE}"
        self.query_one("#view", Static).update(f"{self._view_line}{note}")

    def _selected_view(self) -> tuple[int, Mapping[str, Any]] | None:
        index = self.query_one(OptionList).highlighted
        return None if index is None else (index, self.result["views"][index])

    def action_drop(self) -> None:
        if (selection := self._selected_view()) is None:
            return
        if any(picture.file == selection[1]["file"] for picture in self._dropped):
            self._say(f"{selection[1]['file']} is set aside already: z takes it back.")
        else:
            try:
                self._dropped.append(drop_picture(self.session, selection[1]["file"]))
            except RefracalError as error:
                self._say(str(error))
                return
            self._redraw(
                selection[0],
                f"{selection[1]['file']} is set aside in frames/dropped. Press f to fit without"
                " it, z to take it back.",
            )

    def action_take_back(self) -> None:
        """Take back the selected view, or else the last that was set aside; those from before this
        fit only where there are no others.
        """
        selection = self._selected_view()
        if not self._dropped:
            self._restore_earlier()
            return
        picture = next(
            (
                picture
                for picture in self._dropped
                if selection and picture.file == selection[1]["file"]
            ),
            self._dropped[-1],
        )
        try:
            restore_picture(picture)
        except RefracalError as error:
            self._say(str(error))
            return
        self._dropped.remove(picture)
        index = next(
            i for i, view in enumerate(self.result["views"]) if view["file"] == picture.file
        )
        self._redraw(index, f"{picture.file} is back.")

    def _restore_earlier(self) -> None:
        picture = self._dropped_earlier[-1]
        try:
            restore_picture(picture)
        except RefracalError as error:
            self._say(str(error))
            return
        self._dropped_earlier.remove(picture)
        self._taken_back = True
        self._say(f"{picture.file} is back. Press f to fit with it.")
        self.refresh_bindings()

    def _redraw(self, index: int, sentence: str) -> None:
        self.query_one(OptionList).replace_option_prompt_at_index(
            index, self._line(self.result["views"][index])
        )
        self._say(sentence)
        self.refresh_bindings()

    def _say(self, sentence: str) -> None:
        """Show a sentence below the headline, where a terminal has room for one of the two: in
        place of the details.
        """
        said = self.query_one("#said", Static)
        said.update(harmless(sentence))
        said.display = True
        self._arrange()

    def action_refit(self) -> None:
        self.post_message(self.RefitRequested(self))

    def action_refit_unseen(self) -> None:
        """Fit anew where the line of keys has no room for it: the views are the same."""
        self.action_refit()

    def action_check_unseen(self) -> None:
        """Check where the line of keys has no room for it: views are set aside."""
        self.action_check()

    @on(ScreenResume)
    def _refresh_update(self) -> None:
        """Show the update if a check has just made one."""
        note = self._text.update_note()
        if note and not self._update_shown:
            self._say(note)
        self._update_shown = bool(note)

    def action_export(self) -> None:
        session = self.session
        text = self._text
        calibration = text.calibration
        note = EARLIER_FIT_NOTE if self._dropped else text.headline if text.is_forbidden else ""
        if folder := updated_folder(calibration.parent):
            session = folder
            calibration = folder / CALIBRATION_FILE
            note = (
                f"These maps are of the calibration as a check has brought it up to date: {folder}"
            )
        pictures = frames_folder(self.session)
        screen = ExportScreen(
            session,
            calibration,
            text.depth,
            text.boards,
            note=note,
            in_air=not text.is_forbidden and self.result.get("medium") == AIR,
            pictures=pictures,
            has_black_border=text.has_black_border,
        )
        self.app.push_screen(screen, lambda wrote: self._say(wrote) if wrote else None)

    def action_report(self) -> None:
        calibration = self._text.calibration
        replacement = (
            " anew, in place of the one that is there"
            if (calibration.parent / "report.html").exists()
            else ""
        )
        self._say(f"The report is being written{replacement}, which takes some seconds.")
        self._report(calibration, on_page=self.query_one(Picture).phone)

    @work(thread=True, exclusive=True, group="report", description="writes the report")
    def _report(self, calibration: Path, *, on_page: bool) -> None:
        done = calib(["report", str(calibration), *(["--no-open"] if self.app.is_web else [])])
        written = (
            f"The report is written: touch {OPEN_REPORT}."
            if on_page
            else f"The report is {done.stdout.strip()}: open it in a browser, where it is not open"
            " already."
        )
        self.post_message(self.ReportWritten(written if done.returncode == 0 else done.sentence))

    @on(ReportWritten)
    def _show_report_result(self, message: ReportWritten) -> None:
        self._say(message.sentence)

    def action_check(self) -> None:
        text = self._text
        self.post_message(
            self.CheckRequested(self.session, text.calibration, text.depth, text.boards)
        )

    def action_effects(self) -> None:
        screen = EffectsScreen(self._text.calibration)

        def use(wanted: bool | None) -> None:
            if wanted:
                self.app.switch_screen(ResultsScreen(self.session, screen.result, self.result))
            elif screen.result and not screen.result["accepted"]:
                self._is_faultless = True
                self.query_one("#onward", Static).update(self._next_steps)

        self.app.push_screen(screen, use)

    def action_back(self) -> None:
        self.app.pop_screen()
