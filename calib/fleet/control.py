"""Control charts: the distance of each camera's number from the fleet's, in robust spreads, and the
threshold beyond which it is no chance.

A fleet's limits come from the fleet itself: its median, and its median absolute deviation as the
spread, which a tenth of broken cameras hardly moves. A camera whose number is less certain than
those of the fleet may be farther away by as much. The false alarms are counted over all cameras and
charts of a fleet together (Bonferroni): in one of twenty fleets without a fault, a camera is named.

Source: W. A. Shewhart, Economic Control of Quality of Manufactured Product (1931), with F. R.
Hampel, The influence curve and its role in robust estimation (1974) for the spread; W. H. Kruskal,
W. A. Wallis, Use of ranks in one-criterion variance analysis (1952).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import kruskal, t

from calib.estimation.robust import SIGMA
from calib.fleet.limits import EFFECTIVE, QUALITY

Array = NDArray[np.float64]

ALPHA = 0.05
"""Probability that a fleet without a fault has a camera beyond a limit, over all its charts."""
BATCH_ALPHA = 0.01
"""Probability that batches of such a fleet are found to differ, over all charts."""
MIN_CAMERAS = 5
"""Cameras of a fleet or a batch that a median needs."""
EFFICIENCY = 0.37
"""Statistical efficiency of the median absolute deviation: a standard deviation is as certain with
this fraction of the cameras.
"""
MIN_LOG_EXCESS = float(np.log(1.2))
"""An error or a noise that is less than a fifth above the fleet's does no harm, even if all other
cameras are equal.
"""
MAX_SPREADS = 1e6
"""Larger distances are cut here: the spread is 0 if all other cameras are equal."""


@dataclass(frozen=True, slots=True)
class Batch:
    """The cameras of one fixture or one day, in a chart whose fixtures or days differ."""

    name: str
    centre: float
    count: int


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """One number, over N cameras."""

    name: str
    unit: str
    value: Array
    """(N,), NaN for a camera without this number."""
    sigma: Array
    """(N,) standard deviations, from the fits."""
    centre: Array
    """(N,) the fleet's median, or the median of the camera's batch if batches differ."""
    spread: float
    """The spread of usual cameras about their centre; of logarithms, if the chart is one-sided."""
    spreads: Array
    """(N,) distances from the centre in spreads, positive above it."""
    threshold: float
    """The distance in spreads beyond which a camera stands out."""
    factor: str = ""
    """fixture or date, if its batches differ; otherwise empty."""
    batches: tuple[Batch, ...] = ()
    p_value: float = 1.0
    """The p-value of the difference between batches."""

    @property
    def one_sided(self) -> bool:
        return self.name in QUALITY

    def limits(self, centre: float) -> tuple[float, float]:
        """Return the lower and upper limit about a centre, for a camera of usual sigma."""
        if self.one_sided:
            return 0.0, centre * float(np.exp(max(self.threshold * self.spread, MIN_LOG_EXCESS)))
        return centre - self.threshold * self.spread, centre + self.threshold * self.spread

    @property
    def is_outlier(self) -> NDArray[np.bool_]:
        """(N,) true for cameras that stand out."""
        distance = self.spreads if self.one_sided else np.abs(self.spreads)
        with np.errstate(invalid="ignore"):
            far = distance > self.threshold
            if self.one_sided:
                far &= np.log(self.value / self.centre) > MIN_LOG_EXCESS
        return np.asarray(far)


def charts(
    numbers: Sequence[Mapping[str, tuple[float, float, str]]],
    factors: Mapping[str, Sequence[str]],
    alpha: float = ALPHA,
) -> tuple[Chart, ...]:
    """Return a chart of every number that MIN_CAMERAS cameras have and that differs between them.

    Args:
        numbers: for each camera, by name: value, standard deviation, unit.
        factors: fixture and date of each camera; empty if unknown.
        alpha: the probability of a false alarm, over all charts.
    """
    names = list(dict.fromkeys(name for camera in numbers for name in camera))
    order = {name: place for place, name in enumerate((*QUALITY, *EFFECTIVE))}
    # The numbers of camera and cover stay in the order of their fits.
    names.sort(key=lambda name: order.get(name, len(order)))
    columns = {
        name: np.array(
            [camera.get(name, (np.nan, 0.0, ""))[:2] for camera in numbers], dtype=np.float64
        )
        for name in names
    }
    charted = [name for name, column in columns.items() if _varies(column[:, 0])]
    tests = sum(int(np.isfinite(columns[name][:, 0]).sum()) for name in charted)
    units = {name: unit for camera in numbers for name, (_, _, unit) in camera.items()}
    groups = {
        factor: np.array(labels)
        for factor, labels in factors.items()
        if len(set(labels) - {""}) > 1
    }
    return tuple(
        _chart(name, units[name], columns[name], groups, alpha / tests, len(charted))
        for name in charted
    )


def _varies(values: Array) -> bool:
    finite = values[np.isfinite(values)]
    return len(finite) >= MIN_CAMERAS and bool(np.ptp(finite) > 0)


def _chart(
    name: str, unit: str, column: Array, groups: Mapping[str, NDArray], rate: float, count: int
) -> Chart:
    value, sigma = column.T
    above = name in QUALITY
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = np.log(value) if above else value
        scale_sigma = sigma / value if above else sigma
    scale = np.where(np.isfinite(scale), scale, np.nan)
    middle = np.full(len(scale), np.nanmedian(scale))
    factor, p_value = _differing_factor(scale, groups)
    batches: tuple[Batch, ...] = ()
    if p_value < BATCH_ALPHA / (count * max(1, len(groups))):
        members = {
            label: scale[(groups[factor] == label) & np.isfinite(scale)]
            for label in sorted(set(groups[factor]) - {""})
        }
        centres = {
            label: float(np.median(values))
            for label, values in members.items()
            if len(values) >= MIN_CAMERAS
        }
        middle = np.array([centres.get(label, np.nanmedian(scale)) for label in groups[factor]])
        batches = tuple(
            Batch(label, float(np.exp(c) if above else c), len(members[label]))
            for label, c in centres.items()
        )
    deviation = scale - middle
    finite = np.isfinite(deviation)
    spread = SIGMA * float(np.median(np.abs(deviation[finite])))
    usual_variance = float(np.median(scale_sigma[finite] ** 2))
    camera_spread = np.sqrt(spread**2 + np.maximum(0.0, scale_sigma**2 - usual_variance))
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.clip(deviation / camera_spread, -MAX_SPREADS, MAX_SPREADS)
        spreads = np.where(deviation == 0, 0.0, ratio)
    threshold = float(
        t.isf(rate if above else rate / 2, max(1.0, EFFICIENCY * (int(finite.sum()) - 1)))
    )
    centre = np.exp(middle) if above else middle
    return Chart(
        name=name,
        unit=unit,
        value=value,
        sigma=sigma,
        centre=centre,
        spread=spread,
        spreads=spreads,
        threshold=threshold,
        factor=factor if batches else "",
        batches=batches,
        p_value=p_value,
    )


def _differing_factor(scale: Array, groups: Mapping[str, NDArray]) -> tuple[str, float]:
    """Return the factor whose batches differ most, and the p-value of the difference."""
    p_values: dict[str, float] = {}
    for factor, labels in groups.items():
        batches = [
            scale[(labels == label) & np.isfinite(scale)] for label in set(labels.tolist()) - {""}
        ]
        batches = [batch for batch in batches if len(batch) >= MIN_CAMERAS]
        if len(batches) > 1 and np.ptp(np.concatenate(batches)) > 0:
            p_values[factor] = float(kruskal(*batches).pvalue)
    return min(p_values.items(), key=lambda item: item[1], default=("", 1.0))
