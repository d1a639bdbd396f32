"""Who stands out of a fleet, and why, in words."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from scipy.stats import norm

from calib.checking.result import CheckStatus
from calib.errors import harmless
from calib.fitting.rounding import with_sigma
from calib.fleet.control import ALPHA, Chart, charts
from calib.fleet.manifest import Entry
from calib.fleet.result import Result, State
from calib.verdict.verdict import Word

RARE = 0.1
"""Of the cameras: an effect that the diagnosis found in more is the fleet's way to be."""
NO_CALIBRATION, NOT_TO_BE_USED, BEYOND_LIMIT, FOUND = 1e9, 1e8, 1e7, 10.0
"""Gravities beside numbers of spreads, for the order."""
TITLES = {
    "error_px": "what the fit leaves",
    "held_out_px": "held-out error",
    "noise_px": "noise of the corners",
    "sigma_px": "sigma of the maps",
    "relief_um": "unevenness of the glass",
    "effective_fx": "effective focal length, x",
    "effective_fy": "effective focal length, y",
    "camera.fx": "focal length, x",
    "camera.fy": "focal length, y",
    "camera.cx": "principal point, x",
    "camera.cy": "principal point, y",
}
"""Other numbers are called as session.yaml calls them."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One reason to look at a camera."""

    gravity: float
    """The worst is the largest."""
    sentence: str
    """Without a capital and a full stop."""
    chart: str = ""
    """The number that it is about."""


@dataclass(frozen=True, slots=True)
class Fleet:
    """Every camera with its result, and what stands out; the cameras are in the order of their days
    and of the manifest.
    """

    entries: tuple[Entry, ...]
    results: tuple[Result, ...]
    charts: tuple[Chart, ...]
    findings: Mapping[str, tuple[Finding, ...]]
    """By camera, the gravest first; no others are in it."""
    changed_beyond: float
    """Sigmas from a prior, from where on a number has moved."""

    @property
    def outliers(self) -> list[str]:
        """Ids, the gravest first."""
        return sorted(self.findings, key=lambda camera: -self.findings[camera][0].gravity)

    def day(self, index: int) -> str:
        return self.entries[index].date or self.results[index].recorded


def judge_fleet(entries: Sequence[Entry], results: Mapping[str, Result]) -> Fleet:
    """What stands out of these cameras, each of which has its result.

    The false alarms are shared out over what is asked: the charts, the numbers that moved, and the
    checks of priors.
    """
    ordered = sorted(entries, key=lambda entry: entry.date or results[entry.id].recorded)
    own = [results[entry.id] for entry in ordered]
    days = [entry.date or result.recorded for entry, result in zip(ordered, own, strict=True)]
    numbers = [
        {name: (one.value, one.sigma, one.unit) for name, one in result.numbers.items()}
        for result in own
    ]
    compared = sum(len(result.moved) for result in own)
    checked = sum(bool(result.check) for result in own)
    alpha = ALPHA / (1 + bool(compared) + bool(checked))
    drawn = charts(numbers, {"fixture": [entry.fixture for entry in ordered], "date": days}, alpha)
    beyond = float(norm.isf(alpha / 2 / max(1, compared)))
    effects = Counter(effect for result in own for effect in result.effects)
    found: dict[str, tuple[Finding, ...]] = {}
    for index, (entry, result) in enumerate(zip(ordered, own, strict=True)):
        reasons = [
            *_by_itself(entry, result),
            *_against_prior(result, beyond, alpha / max(1, checked)),
            *_among(index, drawn),
            *_effects(result, effects, len(own)),
        ]
        if reasons:
            found[entry.id] = tuple(sorted(reasons, key=lambda finding: -finding.gravity))
    return Fleet(tuple(ordered), tuple(own), drawn, found, beyond)


def title_of(name: str) -> str:
    return TITLES.get(name, name)


def _by_itself(entry: Entry, result: Result) -> Iterator[Finding]:
    if result.state is not State.CALIBRATED:
        yield Finding(NO_CALIBRATION, f"no calibration: {result.sentence.rstrip('.')}")
    if result.verdict.get("word") == Word.DO_NOT_USE.value:
        because = str(next(iter(result.verdict["reasons"]), "")).rstrip(".")
        yield Finding(NOT_TO_BE_USED, f"its verdict is not to use it: {because}")
    for limit in entry.limits:
        one = result.numbers.get(limit.name)
        if one and limit.broken(one.value):
            yield Finding(
                BEYOND_LIMIT,
                f"{title_of(limit.name)} is {one.value:.5g} {one.unit}, where its limit is {limit}",
                limit.name,
            )
    for remark in result.remarks:
        if remark.startswith("Its prior"):
            yield Finding(FOUND, remark[0].lower() + remark[1:].rstrip("."))


def _against_prior(result: Result, beyond: float, alarm: float) -> Iterator[Finding]:
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
        yield Finding(FOUND, f"its prior is {answer['answer']}: {changes}{added}{lacking}")
    far = {name: one for name, one in result.moved.items() if abs(one.sigmas) > beyond}
    if far:
        name, one = max(far.items(), key=lambda item: abs(item[1].sigmas))
        others = f", and {len(far) - 1} other number{'s' * (len(far) > 2)}" if len(far) > 1 else ""
        yield Finding(
            abs(one.sigmas),
            f"{title_of(name)} moved by {one.sigmas:+.1f} sigmas from its prior, {one.before:.6g}"
            f" to {one.after:.6g} {one.unit}".rstrip()
            + others,
            name,
        )


def _among(index: int, drawn: Sequence[Chart]) -> Iterator[Finding]:
    for chart in drawn:
        if not chart.out[index]:
            continue
        value, sigma, centre = chart.value[index], chart.sigma[index], chart.centre[index]
        if chart.one_sided:
            said = (
                f"{title_of(chart.name)} is {value / centre:.1f} times the fleet's, {value:.3g}"
                f" {chart.unit} where it has {centre:.3g}"
            )
        else:
            said = (
                f"{title_of(chart.name)} is {with_sigma(value, sigma)} {chart.unit}".rstrip()
                + f", where the fleet has {centre:.5g}"
            )
        away = abs(float(chart.spreads[index]))
        told = (
            f"{away:.0f} spreads away"
            if math.isfinite(away) and away < 1e5
            else "where all others are alike"
        )
        yield Finding(away, f"{said} ({told})", chart.name)


def _effects(result: Result, effects: Counter[str], count: int) -> Iterator[Finding]:
    for effect in result.effects:
        if effects[effect] <= max(1.0, RARE * count):
            others = effects[effect] - 1
            beside = (
                f"{others} other camera{'s' * (others > 1)} of {count}"
                f" {'have' if others > 1 else 'has'}"
                if others
                else "no other has"
            )
            yield Finding(FOUND, harmless(f"its diagnosis found {effect}, which {beside}"))
