"""The words of the results' screen: the verdict, the stages, the views, and the next steps."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from calib.errors import harmless
from calib.rounding import two_digits
from calib.verdict.verdict import Trust
from capture.tui.child import Event
from capture.tui.corrected_fields import FIT_ANEW, in_form_words, list_labels
from capture.tui.farewell import propose_depth, updated_folder

BAR_COLUMNS = 12  # columns
GLASS_NOTE = "smooth: ideal glass; fitted: its waves as well"
ALIKE = 0.9
"""The error of the fitted cover over that of the camera alone from which the two are alike."""
ALIKE_NOTE = "alike: this cover bends light like a lens"
MAX_REASONS = 2  # the number of the verdict's reasons: more do not fit below the picture
DIAGNOSED_STAGE = "cover+rbf+effects"


@dataclass(frozen=True, slots=True)
class ResultsText:
    """What a result says, in words."""

    result: Event
    """As `fit_session` gives it."""
    previous: Event | None
    """The result to compare with."""

    @property
    def calibration(self) -> Path:
        """The calibration's file."""
        return Path(self.result["calibration"])

    @property
    def depth(self) -> float:
        """m, the proposed depth of maps."""
        if depths := [float(entry["depth_m"]) for entry in self.result["sigma_px"]]:
            return depths[len(depths) // 2]  # the median of the corners
        return propose_depth(self.calibration.parent)

    @property
    def has_black_border(self) -> bool:
        """True if straight pictures for that depth have a black border unless it is cropped."""
        return bool(self.result.get("black_border"))

    @property
    def boards(self) -> tuple[float, float] | None:
        """m, the depths of the nearest and the farthest corners, if they are known."""
        depths = [float(entry["depth_m"]) for entry in self.result["sigma_px"]]
        return (min(depths), max(depths)) if depths else None

    @property
    def is_trusted(self) -> bool:
        return bool(self.result["verdict"]["word"] == Trust.TRUSTED.value)

    @property
    def is_forbidden(self) -> bool:
        return bool(self.result["verdict"]["word"] == Trust.DO_NOT_USE.value)

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of the set-up's fields to correct before the next fit; empty if it is another
        step that comes next.
        """
        return tuple(self.result["verdict"].get("fields", ()))

    @property
    def correction(self) -> str:
        """The sentence about these fields for the set-up."""
        sentence = in_form_words(self.result["verdict"]["sentences"][1])
        return harmless(f"{sentence} {FIT_ANEW}")

    @property
    def headline(self) -> str:
        """The verdict's first sentence: whether the calibration can be used."""
        return harmless(self.result["verdict"]["sentences"][0])

    @property
    def stages(self) -> str:
        """The table of the errors of each stage of the fit."""
        previous = (
            {stage["name"]: stage for stage in self.previous["stages"]} if self.previous else {}
        )
        lines = [
            f"{'error, unweighted':<18}{'picture':>9}{'on board':>10}"
            f" {'before' if previous else ''}"
        ]
        for stage in self.result["stages"]:
            previous_text = (
                f"{previous[stage['name']]['rms_px']:>8.3f}" if stage["name"] in previous else ""
            )
            lines.append(
                f"{stage['title']:<18}{stage['rms_px']:>6.3f} px{10 * stage['rmse_cm']:>8.3f}"
                f" mm{previous_text}"
            )
        if any(stage["name"] == "cover" for stage in self.result["stages"]):
            lines.append(GLASS_NOTE)
            first, last = self.result["stages"][0], self.result["stages"][-1]
            if last["rms_px"] > ALIKE * first["rms_px"]:
                lines.append(ALIKE_NOTE)
        return "\n".join(lines)

    def details(self, set_aside: int) -> Iterator[str]:
        """Yield the sentences below the headline.

        Args:
            set_aside: the number of views that were set aside since the fit.
        """
        verdict = self.result["verdict"]["sentences"]
        yield from _aside_note(set_aside)
        if update := self.update_note():
            yield update
        yield from _reasons(verdict[1:])
        yield from (f"Note: {note}" for note in self.result.get("notes", ()))
        yield self._error
        if sigmas := self.result["sigma_px"]:
            worst = max(entry["px"] for entry in sigmas)
            near, far = sigmas[0]["depth_m"], sigmas[-1]["depth_m"]
            yield (
                f"The maps are accurate to {two_digits(worst)} px or better from {near:g} to"
                f" {far:g} m (sigma){self._if_sides_are_right}."
            )
        if noisier := self.result.get("noisier"):
            yield noisier
        if rejected := self.result["rejected"]:
            suffix = f" and {len(rejected) - 1} more" if len(rejected) > 1 else ""
            yield f"Not used: {rejected[0]['file']} ({rejected[0]['reason']}){suffix}."

    @property
    def _if_sides_are_right(self) -> str:
        """The condition that no picture can show: the stated size of the board's squares."""
        sides = self.result.get("sides")
        return f", if the board's {sides}" if sides else ""

    @property
    def _error(self) -> str:
        """The error of the fit, and the noise of the corners."""
        first = self.result["stages"][0]["rms_px"]
        last = self.result["stages"][-1]["rms_px"]
        noise = self.result["noise_px"]
        words = "unknown" if noise is None else f"{noise:.3f} px"
        has_fallen = round(first, 3) > round(last, 3)
        error = (
            f"The error fell from {first:.3f} to {last:.3f} px"
            if has_fallen
            else f"The error is {last:.3f} px"
        )
        return f"{error}; the corners' own noise is {words}."

    def update_note(self) -> str:
        """Return the sentence about a check's update of the calibration; empty without one."""
        folder = updated_folder(self.calibration.parent)
        if not folder:
            return ""
        return (
            f"A check has brought this calibration up to date, into {folder.name}/: x exports that."
        )

    def next_steps(self, *, is_faultless: bool) -> str:
        """Return the keys to press next.

        Args:
            is_faultless: True if a diagnosis has found nothing.
        """
        exports = "x for maps and straight pictures"
        if self.is_trusted:
            is_diagnosed = any(stage["name"] == DIAGNOSED_STAGE for stage in self.result["stages"])
            faults = "" if is_diagnosed or is_faultless else ", e to find faults"
            return f"Press r for the report, {exports}{faults}."
        correct = f"s to correct {list_labels(self.fields)} in the set-up, " if self.fields else ""
        if self.is_forbidden:
            return f"Press {correct}r for the report, which says more."
        if self.result["verdict"].get("maps_hold") and not self.fields:
            faults = "" if is_faultless else ", e to find faults"
            return f"Press {exports}, r for the report{faults}."
        faults = "" if is_faultless else "e to find faults, "
        return f"Press {correct}{faults}r for the report, {exports}."

    def view_line(self, view: Mapping[str, Any], *, is_dropped: bool) -> str:
        """Return the line of a view in the list."""
        worst = self.result["views"][0]["rms_px"]
        bar = "dropped" if is_dropped else "█" * max(round(BAR_COLUMNS * view["rms_px"] / worst), 1)
        return f"{harmless(view['file'])[-16:]:<16} {view['rms_px']:>6.3f} px {bar}"


def _aside_note(count: int) -> Sequence[str]:
    if count == 0:
        return ()
    if count == 1:
        return ("1 view was set aside since this fit: f fits without it, z takes it back.",)
    return (f"{count} views were set aside since this fit: f fits without them, z takes one back.",)


def _reasons(sentences: Sequence[str]) -> Iterator[str]:
    """Yield the verdict's reasons, and how many more are in the report."""
    yield from sentences[:MAX_REASONS]
    omitted = len(sentences) - MAX_REASONS
    if omitted == 1:
        yield "One more reason is in the report."
    elif omitted > 1:
        yield f"{omitted} more reasons are in the report."
