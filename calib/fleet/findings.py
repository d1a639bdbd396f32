"""The findings of a fleet: which cameras stand out, and the reasons in words."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from scipy.stats import norm

from calib.checking.result import CheckStatus
from calib.errors import harmless
from calib.fleet.control import ALPHA, Chart, charts
from calib.fleet.manifest import Entry
from calib.fleet.result import JobState, Result
from calib.rounding import with_sigma
from calib.session.parameter_names import CAMERA
from calib.verdict.unit_words import unit_doubts
from calib.verdict.verdict import Trust

RARE_FRACTION = 0.1
"""Fraction of the cameras. An effect that more of them have is common to the fleet."""
NO_CALIBRATION = 1e9
NOT_TO_BE_USED = 1e8
BEYOND_LIMIT = 1e7
CHECK_OR_DIAGNOSIS = 10.0
"""Gravities, to be ordered together with distances in spreads."""
TITLES = {
    "error_px": "what the fit leaves",
    "held_out_px": "held-out error",
    "noise_px": "noise of the corners",
    "sigma_px": "sigma of the maps",
    "relief_um": "uneven glass",
    "effective_fx": "effective focal length, x",
    "effective_fy": "effective focal length, y",
    CAMERA.fx: "focal length, x",
    CAMERA.fy: "focal length, y",
    CAMERA.cx: "principal point, x",
    CAMERA.cy: "principal point, y",
}
"""Titles of numbers. All other numbers are called as session.yaml calls them."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One reason to look at a camera."""

    gravity: float
    """A larger value is worse."""
    sentence: str
    """A sentence without a capital and a full stop."""
    chart: str = ""
    """The name of the number that it is about; may be empty."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """Every camera with its result, and the findings.

    The cameras are ordered by their days, then as in the manifest.
    """

    entries: tuple[Entry, ...]
    results: tuple[Result, ...]
    charts: tuple[Chart, ...]
    findings: Mapping[str, tuple[Finding, ...]]
    """The findings of each camera that has any, the gravest first."""
    shift_limit: float
    """The distance from a prior in sigmas beyond which a number has moved."""

    @property
    def outliers(self) -> list[str]:
        """Return the ids of cameras with findings, the gravest first."""
        return sorted(self.findings, key=lambda camera: -self.findings[camera][0].gravity)

    def day(self, index: int) -> str:
        return self.entries[index].date or self.results[index].recorded


def judge_fleet(entries: Sequence[Entry], results: Mapping[str, Result]) -> Fleet:
    """Return the findings of cameras that all have a result.

    The probability of a false alarm is divided among the charts, the shifts from priors, and the
    checks of priors.
    """
    ordered = sorted(entries, key=lambda entry: entry.date or results[entry.id].recorded)
    ordered_results = [results[entry.id] for entry in ordered]
    days = [
        entry.date or result.recorded
        for entry, result in zip(ordered, ordered_results, strict=True)
    ]
    numbers = [
        {name: (item.value, item.sigma, item.unit) for name, item in result.numbers.items()}
        for result in ordered_results
    ]
    compared = sum(len(result.shifts) for result in ordered_results)
    checked = sum(bool(result.check) for result in ordered_results)
    alpha = ALPHA / (1 + bool(compared) + bool(checked))
    drawn = charts(numbers, {"fixture": [entry.fixture for entry in ordered], "date": days}, alpha)
    shift_limit = float(norm.isf(alpha / 2 / max(1, compared)))
    effects = Counter(effect for result in ordered_results for effect in result.effects)
    noted = sum(bool(_noted_doubts(result)) for result in ordered_results)
    small_boards = noted > len(ordered_results) / 2
    findings: dict[str, tuple[Finding, ...]] = {}
    for index, (entry, result) in enumerate(zip(ordered, ordered_results, strict=True)):
        reasons = [
            *_camera_findings(entry, result, small_boards=small_boards),
            *_prior_findings(result, shift_limit, alpha / max(1, checked)),
            *_chart_findings(index, drawn),
            *_effect_findings(result, effects, len(ordered_results)),
        ]
        if reasons:
            findings[entry.id] = tuple(sorted(reasons, key=lambda finding: -finding.gravity))
    return Fleet(tuple(ordered), tuple(ordered_results), drawn, findings, shift_limit)


def title_of(name: str) -> str:
    return TITLES.get(name, name)


def _noted_doubts(result: Result) -> tuple[str, ...]:
    """Return the notes of a verdict that doubt a unit."""
    return unit_doubts(result.verdict.get("notes", ()))


def _camera_findings(entry: Entry, result: Result, *, small_boards: bool) -> Iterator[Finding]:
    """Yield what stands out in a camera by itself. small_boards: most cameras have a note that
    doubts a unit, so that none of them stands out by it.
    """
    if result.state is not JobState.CALIBRATED:
        yield Finding(NO_CALIBRATION, f"no calibration: {result.sentence.rstrip('.')}")
    if result.verdict.get("word") == Trust.DO_NOT_USE.value:
        because = str(next(iter(result.verdict["reasons"]), "")).rstrip(".")
        yield Finding(NOT_TO_BE_USED, f"its verdict is not to use it: {because}")
    verdict = result.verdict
    if verdict.get("word") != Trust.DO_NOT_USE.value:
        notes = () if small_boards else _noted_doubts(result)
        for doubt in (*unit_doubts(verdict.get("reasons", ())), *notes):
            yield Finding(CHECK_OR_DIAGNOSIS, doubt.rstrip("."))
    for limit in entry.limits:
        number = result.numbers.get(limit.name)
        if number and limit.broken(number.value):
            yield Finding(
                BEYOND_LIMIT,
                f"{title_of(limit.name)} is {number.value:.5g} {number.unit}, where its limit is"
                f" {limit}",
                limit.name,
            )
    for remark in result.remarks:
        if remark.startswith("Its prior"):
            yield Finding(CHECK_OR_DIAGNOSIS, remark[0].lower() + remark[1:].rstrip("."))


def _prior_findings(result: Result, shift_limit: float, alarm: float) -> Iterator[Finding]:
    answer = result.check
    if (
        answer
        and answer["answer"] != CheckStatus.VALID.value
        and not (answer["p_value"] or 0.0) > alarm
    ):
        changes = " or ".join(change["sentence"] for change in answer["changes"][:2])
        added = (
            f", which adds {answer['added_px']:.2g} px" if answer["added_px"] is not None else ""
        )
        lacking = " (its prior shows that as well)" if answer["lacking"] else ""
        yield Finding(
            CHECK_OR_DIAGNOSIS, f"its prior is {answer['answer']}: {changes}{added}{lacking}"
        )
    far = {n: shift for n, shift in result.shifts.items() if abs(shift.sigmas) > shift_limit}
    if far:
        name, shift = max(far.items(), key=lambda item: abs(item[1].sigmas))
        addition = (
            f", and {len(far) - 1} other number{'s' * (len(far) > 2)}" if len(far) > 1 else ""
        )
        yield Finding(
            abs(shift.sigmas),
            f"{title_of(name)} moved by {shift.sigmas:+.1f} sigmas from its prior,"
            f" {shift.prior:.6g} to {shift.current:.6g} {shift.unit}".rstrip()
            + addition,
            name,
        )


def _chart_findings(index: int, drawn: Sequence[Chart]) -> Iterator[Finding]:
    for chart in drawn:
        if not chart.is_outlier[index]:
            continue
        value, sigma, centre = chart.value[index], chart.sigma[index], chart.centre[index]
        if chart.one_sided:
            statement = (
                f"{title_of(chart.name)} is {value / centre:.1f} times the fleet's, {value:.3g}"
                f" {chart.unit} where it has {centre:.3g}"
            )
        else:
            statement = (
                f"{title_of(chart.name)} is {with_sigma(value, sigma)} {chart.unit}".rstrip()
                + f", where the fleet has {centre:.5g}"
            )
        distance = abs(float(chart.spreads[index]))
        remark = (
            f"{distance:.0f} spreads away"
            if math.isfinite(distance) and distance < 1e5
            else "where all others are alike"
        )
        yield Finding(distance, f"{statement} ({remark})", chart.name)


def _effect_findings(result: Result, effects: Counter[str], count: int) -> Iterator[Finding]:
    for effect in result.effects:
        if effects[effect] <= max(1.0, RARE_FRACTION * count):
            sharing = effects[effect] - 1
            clause = (
                f"{sharing} other camera{'s' * (sharing > 1)} of {count}"
                f" {'have' if sharing > 1 else 'has'}"
                if sharing
                else "no other has"
            )
            yield Finding(
                CHECK_OR_DIAGNOSIS, harmless(f"its diagnosis found {effect}, which {clause}")
            )
