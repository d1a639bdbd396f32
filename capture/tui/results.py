"""Results: the error before and after, the views from the worst on, and what to do about them."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from textual import on, work
from textual.app import ComposeResult
from textual.binding import Binding
from textual.containers import Horizontal, Vertical
from textual.events import ScreenResume
from textual.message import Message
from textual.widgets import OptionList, Static
from textual.widgets.option_list import Option

from calib.corners.detect import eight_bits
from calib.errors import RefracalError, harmless
from calib.io.images import read_grey
from capture.tui.camera import Preview
from capture.tui.cells import FOUND, WORST, Mark
from capture.tui.child import Event
from capture.tui.command import calib
from capture.tui.drop import Dropped, drop, dropped, dropped_before, take_back
from capture.tui.effects import EffectsScreen
from capture.tui.export import ExportScreen
from capture.tui.farewell import CALIBRATION, DEPTH, updated
from capture.tui.page import HELP_AND_QUIT, Page
from capture.tui.picture import Picture

BAR = 12  # columns
GLASS = "smooth: ideal glass; uneven: its waves as well"
AS_BEFORE = (
    "Views were set aside since this fit: these maps are still of the fit with them. esc, then f,"
    " fits without them."
)
SHOWN = 2  # reasons of the verdict: more do not fit under the picture


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
    ResultsScreen #sentence { height: auto; min-height: 2; max-height: 8; }
    ResultsScreen #onward { height: auto; }
    """
    BINDINGS: ClassVar = [
        Binding("d", "drop", "Drop"),
        Binding("z", "take_back", "Undo"),
        Binding("f", "refit", "Fit"),
        Binding("e", "effects", "Diagnose"),
        Binding("c", "check", "Check"),
        Binding("r", "report", "Report"),
        Binding("x", "export", "Export"),
        Binding("m", "app.dots", show=False),  # with it, the line of keys would not fit
        Binding("escape", "back", "Back", key_display="esc"),
        *HELP_AND_QUIT,
    ]

    class Loaded(Message):
        """A view's picture was read."""

        def __init__(self, view: Mapping[str, Any], preview: Preview | None) -> None:
            super().__init__()
            self.view = view
            self.preview = preview

    class Opened(Message):
        """These are the results of this calibration, by its file."""

        def __init__(self, calibration: Path, depth: float, doubt: str) -> None:
            super().__init__()
            self.calibration = calibration
            self.depth = depth
            """m: of the maps that are proposed."""
            self.doubt = doubt
            """The word of the verdict, as a sentence, if that is not trust."""

    class Reported(Message):
        """The report's command has ended."""

        def __init__(self, sentence: str) -> None:
            super().__init__()
            self.sentence = sentence

    class FitAgain(Message):
        """The views have changed, and these results are no longer theirs."""

        def __init__(self, results: "ResultsScreen") -> None:
            super().__init__()
            self.results = results

    class Doubted(Message):
        """It is to be checked whether this calibration still holds."""

        def __init__(self, session: Path, calibration: Path, depth: float) -> None:
            super().__init__()
            self.session = session
            self.calibration = calibration
            """Its file."""
            self.depth = depth
            """m: of the maps that are proposed."""

    def __init__(self, session: Path, result: Event, before: Event | None = None) -> None:
        """`result` as `fit_session` gives it, and that of the fit before, to compare with."""
        super().__init__()
        self.session = session
        self.result = {**result, "before": {"stages": before["stages"]}} if before else result
        """With what it is compared with."""
        # a diagnosis goes on from the fit itself: beside its numbers the same ones would stand
        fitted = before["stages"] if before else []
        diagnosed = (
            len(result["stages"]) > len(fitted) and result["stages"][: len(fitted)] == fitted
        )
        self._before = None if diagnosed else before
        files = [view["file"] for view in result["views"]]
        self._told_renewed = bool([*self._renewed()])
        """It stands on the screen that a check has brought the calibration up to date."""
        self._dropped: list[Dropped] = dropped(session, files)
        self._dropped_before = dropped_before(
            session, [*files, *(each.now.name for each in self._dropped)]
        )
        """Those that this fit went on without, the last one last."""

    def step(self) -> str:
        return "Results"

    def body(self) -> ComposeResult:
        with Horizontal(id="top"):
            with Vertical(id="left"):
                yield Static(self._stages(), id="stages", markup=False)
                yield Static("Views, the worst first", id="title", markup=False)
                yield OptionList(
                    *(Option(self._line(view), id=view["file"]) for view in self.result["views"]),
                    markup=False,
                    compact=True,
                )
            with Vertical(id="right"):
                yield Picture()
                yield Static(id="view", markup=False)
        yield Static(self._verdict(), id="sentence", classes="banner", markup=False)
        yield Static(self._onward(), id="onward", classes="banner", markup=False)

    def check_action(self, action: str, parameters: tuple[object, ...]) -> bool | None:
        del parameters
        return bool(self._dropped or self._dropped_before) if action == "take_back" else True

    def on_mount(self) -> None:
        self.query_one(OptionList).focus()
        doubt = "" if self._trusted else self.result["verdict"]["sentences"][0]
        self.post_message(self.Opened(Path(self.result["calibration"]), self._depth, doubt))

    @property
    def _depth(self) -> float:
        """m: where most corners are."""
        return float(next((one["depth_m"] for one in self.result["sigma_px"][1:2]), DEPTH))

    @property
    def _boards(self) -> tuple[float, float] | None:
        """m, of the nearest and the farthest corners."""
        depths = [float(one["depth_m"]) for one in self.result["sigma_px"]]
        return (min(depths), max(depths)) if depths else None

    @property
    def _trusted(self) -> bool:
        return bool(self.result["verdict"]["word"] == "trusted")

    def _stages(self) -> str:
        before = {stage["name"]: stage for stage in self._before["stages"]} if self._before else {}
        lines = [
            f"{'error, unweighted':<18}{'picture':>9}{'on board':>10} {'before' if before else ''}"
        ]
        for stage in self.result["stages"]:
            was = f"{before[stage['name']]['rms_px']:>8.3f}" if stage["name"] in before else ""
            lines.append(
                f"{stage['title']:<18}{stage['rms_px']:>6.3f} px{10 * stage['rmse_cm']:>8.3f}"
                f" mm{was}"
            )
        if any(stage["name"] == "cover" for stage in self.result["stages"]):
            lines.append(GLASS)
        return "\n".join(lines)

    def _verdict(self) -> str:
        first, last = (self.result["stages"][place]["rms_px"] for place in (0, -1))
        said = [
            f"The error fell from {first:.3f} to {last:.3f} px; the corners' own noise is"
            f" {self.result['noise_px']:.3f} px."
        ]
        if sigmas := self.result["sigma_px"]:
            at = ", ".join(f"{one['px']:.2g} px at {one['depth_m']:g} m" for one in sigmas)
            said.append(
                f"The maps are sure to {at} (sigma, from the nearest to the farthest corner)."
            )
        word, *reasons = self.result["verdict"]["sentences"]
        more = len(reasons) - SHOWN
        told = [
            *reasons[:SHOWN],
            *([f"{more} more reasons are in the report."] if more > 0 else []),
        ]
        said = [*self._aside(), *self._renewed(), word, *told, *said]
        said += [self.result["noisier"]] if self.result.get("noisier") else []
        if rejected := self.result["rejected"]:
            others = f" and {len(rejected) - 1} more" if len(rejected) > 1 else ""
            said.append(f"Not used: {rejected[0]['file']} ({rejected[0]['reason']}){others}.")
        return harmless(" ".join(said))

    def _aside(self) -> Iterator[str]:
        if (number := len(self._dropped)) == 1:
            yield "1 view was set aside since this fit: f fits without it, z takes it back."
        elif number:
            yield (
                f"{number} views were set aside since this fit: f fits without them, z takes one"
                " back."
            )

    def _renewed(self) -> Iterator[str]:
        if folder := updated(Path(self.result["calibration"]).parent):
            yield (
                f"A check has brought this calibration up to date, into {folder.name}/: x exports"
                " that."
            )

    def _onward(self) -> str:
        effects = "e to look for what the model lacks"
        if self._trusted:
            asked = any(stage["name"] == "cover+rbf+effects" for stage in self.result["stages"])
            return f"Press r for the report, x to export maps{'' if asked else f', {effects}'}."
        return f"Press {effects}, r for the report, x to export maps."

    def _line(self, view: Mapping[str, Any]) -> str:
        gone = any(each.file == view["file"] for each in self._dropped)
        worst = self.result["views"][0]["rms_px"]
        bar = "dropped" if gone else "█" * max(round(BAR * view["rms_px"] / worst), 1)
        return f"{harmless(view['file'])[-16:]:<16} {view['rms_px']:>6.3f} px {bar}"

    @on(OptionList.OptionHighlighted)
    def _show(self, event: OptionList.OptionHighlighted) -> None:
        view = self.result["views"][event.option_index]
        self._load(view, self.query_one(Picture).phone)

    @work(thread=True, exclusive=True, group="picture", description="reads a picture")
    def _load(self, view: Mapping[str, Any], sharp: bool) -> None:
        try:
            preview = Preview.of(eight_bits(read_grey(self._place(view["file"]))), sharp=sharp)
        except RefracalError:
            preview = None
        self.post_message(self.Loaded(view, preview))

    def _place(self, file: str) -> Path:
        return next(
            (each.now for each in self._dropped if each.file == file),
            self.session / "frames" / file,
        )

    @on(Loaded)
    def _loaded(self, message: Loaded) -> None:
        view = message.view
        corners, errors = np.array(view["corners"]), np.array(view["errors"])
        sizes = np.linalg.norm(errors, axis=-1)
        worst = int(np.nanargmax(sizes))
        self.query_one(Picture).show(
            message.preview, [Mark(FOUND, corners), Mark(WORST, corners[[worst]])]
        )
        words = f"{FOUND} corners  {WORST} worst: {sizes[worst]:.2f} px off"
        self.query_one("#view", Static).update(
            words if message.preview else "This picture cannot be read any more."
        )

    def _chosen(self) -> tuple[int, Mapping[str, Any]] | None:
        index = self.query_one(OptionList).highlighted
        return None if index is None else (index, self.result["views"][index])

    def action_drop(self) -> None:
        if (chosen := self._chosen()) is None:
            return
        if any(each.file == chosen[1]["file"] for each in self._dropped):
            self._say(f"{chosen[1]['file']} is set aside already: z takes it back.")
        else:
            try:
                self._dropped.append(drop(self.session, chosen[1]["file"]))
            except RefracalError as error:
                self._say(str(error))
                return
            self._redraw(
                chosen[0],
                f"{chosen[1]['file']} is set aside in frames/dropped. Press f to fit without it, z"
                " to take it back.",
            )

    def action_take_back(self) -> None:
        """The chosen view, or else the last that was set aside; of those before this fit only where
        there are no others.
        """
        chosen = self._chosen()
        if not self._dropped:
            self._take_back_earlier()
            return
        one = next(
            (each for each in self._dropped if chosen and each.file == chosen[1]["file"]),
            self._dropped[-1],
        )
        try:
            take_back(one)
        except RefracalError as error:
            self._say(str(error))
            return
        self._dropped.remove(one)
        index = next(i for i, view in enumerate(self.result["views"]) if view["file"] == one.file)
        self._redraw(index, f"{one.file} is back.")

    def _take_back_earlier(self) -> None:
        one = self._dropped_before[-1]
        try:
            take_back(one)
        except RefracalError as error:
            self._say(str(error))
            return
        self._dropped_before.remove(one)
        self._say(f"{one.file} is back. Press f to fit with it.")
        self.refresh_bindings()

    def _redraw(self, index: int, sentence: str) -> None:
        self.query_one(OptionList).replace_option_prompt_at_index(
            index, self._line(self.result["views"][index])
        )
        self._say(sentence)
        self.refresh_bindings()

    def _say(self, sentence: str) -> None:
        """Above what stays so: the word of the verdict."""
        lasting = self.result["verdict"]["sentences"][0]
        self.query_one("#sentence", Static).update(f"{harmless(sentence)}\n{harmless(lasting)}")

    def action_refit(self) -> None:
        self.post_message(self.FitAgain(self))

    @on(ScreenResume)
    def _came_back(self) -> None:
        """Perhaps from a check that has changed what there is to export."""
        renewed = [*self._renewed()]
        if renewed and not self._told_renewed:
            self._say(renewed[0])
        self._told_renewed = bool(renewed)

    def action_export(self) -> None:
        calibration = Path(self.result["calibration"])
        if folder := updated(calibration.parent):
            note = f"Of the calibration as a check has brought it up to date: {folder}"
            screen = ExportScreen(
                folder, folder / CALIBRATION, self._depth, self._boards, note=note
            )
        else:
            note = AS_BEFORE if self._dropped else ""
            screen = ExportScreen(self.session, calibration, self._depth, self._boards, note=note)
        self.app.push_screen(screen, lambda wrote: self._say(wrote) if wrote else None)

    def action_report(self) -> None:
        calibration = Path(self.result["calibration"])
        anew = (
            " anew, in place of the one that is there"
            if (calibration.parent / "report.html").exists()
            else ""
        )
        self._say(f"The report is being written{anew}, which takes some seconds.")
        self._report(calibration)

    @work(thread=True, exclusive=True, group="report", description="writes the report")
    def _report(self, calibration: Path) -> None:
        done = calib(["report", str(calibration)])
        written = (
            f"The report is {done.stdout.strip()}: open it in a browser, where it is not open"
            " already."
        )
        self.post_message(self.Reported(written if done.returncode == 0 else done.sentence))

    @on(Reported)
    def _reported(self, message: Reported) -> None:
        self._say(message.sentence)

    def action_check(self) -> None:
        self.post_message(self.Doubted(self.session, Path(self.result["calibration"]), self._depth))

    def action_effects(self) -> None:
        screen = EffectsScreen(Path(self.result["calibration"]))

        def use(wanted: bool | None) -> None:
            if wanted:
                self.app.switch_screen(ResultsScreen(self.session, screen.result, self.result))

        self.app.push_screen(screen, use)

    def action_back(self) -> None:
        self.app.pop_screen()
