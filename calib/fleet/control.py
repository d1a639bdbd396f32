"""Control charts: how far each camera's number is from the fleet's, in robust spreads, and from
where on that is no chance.

A fleet's limits come from the fleet itself: its median, and its median absolute deviation as the
spread, which a tenth of broken cameras hardly moves. A camera whose number is less sure than the
others' may be farther away by as much. The false alarms are counted over all cameras and charts of
a fleet together (Bonferroni): in one of twenty fleets without a fault, a camera is named.

Source: W. A. Shewhart, Economic Control of Quality of Manufactured Product (1931), with F. R.
    Hampel, The influence curve and its role in
robust estimation (1974) for the spread; W. H. Kruskal, W. A. Wallis, Use of ranks in one-criterion
variance analysis (1952).
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
"""Chance that a fleet without a fault has a camera beyond a limit, over all cameras and charts."""
APART = 0.01
"""Chance that batches of such a fleet are told apart, over all charts."""
FEWEST = 5
"""Cameras, of a fleet or a batch, that say what is usual."""
EFFICIENCY = 0.37
"""Of the median absolute deviation against the standard deviation: with so many of the cameras,
that would be as sure.
"""
NOTICEABLE = float(np.log(1.2))
"""An error or a noise that is a fifth above the fleet's harms nobody yet, however alike the others
are.
"""
FARTHEST = 1e6
"""Spreads: what is farther, as where all others are equal, is as far."""


@dataclass(frozen=True, slots=True)
class Batch:
    """Cameras of one fixture or one day, in a chart in which these differ."""

    name: str
    centre: float
    count: int


@dataclass(frozen=True, slots=True, eq=False)
class Chart:
    """One number of N cameras."""

    name: str
    unit: str
    value: Array
    """(N,), NaN where a camera has none."""
    sigma: Array
    """(N,) of each, as its fit says."""
    centre: Array
    """(N,): the fleet's median, or that of the camera's batch where batches differ."""
    spread: float
    """Of the usual camera about its centre; of the logarithm, where the chart is one-sided."""
    spreads: Array
    """(N,) how far each is from its centre, in spreads; positive above."""
    threshold: float
    """Spreads, from where on a camera stands out."""
    factor: str = ""
    """fixture or date, where their batches differ."""
    batches: tuple[Batch, ...] = ()
    p_value: float = 1.0
    """Of the batches' difference."""

    @property
    def one_sided(self) -> bool:
        return self.name in QUALITY

    def limits(self, centre: float) -> tuple[float, float]:
        """The least and the most about a centre, for a camera of usual sigma."""
        if self.one_sided:
            return 0.0, centre * float(np.exp(max(self.threshold * self.spread, NOTICEABLE)))
        return centre - self.threshold * self.spread, centre + self.threshold * self.spread

    @property
    def out(self) -> NDArray[np.bool_]:
        """(N,) who stands out."""
        beyond = self.spreads if self.one_sided else np.abs(self.spreads)
        with np.errstate(invalid="ignore"):
            far = beyond > self.threshold
            if self.one_sided:
                far &= np.log(self.value / self.centre) > NOTICEABLE
        return np.asarray(far)


def charts(
    numbers: Sequence[Mapping[str, tuple[float, float, str]]],
    factors: Mapping[str, Sequence[str]],
    alpha: float = ALPHA,
) -> tuple[Chart, ...]:
    """A chart of every number that FEWEST cameras have and that is not the same for all.

    Args:
        numbers: of each camera, by name: value, standard deviation, unit.
        factors: fixture and date: each camera's, empty where it is not known.
        alpha: the chance of a false alarm, over all of them.
    """
    names = list(dict.fromkeys(name for own in numbers for name in own))
    order = {name: place for place, name in enumerate((*QUALITY, *EFFECTIVE))}
    names.sort(
        key=lambda name: order.get(name, len(order))
    )  # the numbers of camera and cover stay in the order of their fits
    columns = {
        name: np.array([own.get(name, (np.nan, 0.0, ""))[:2] for own in numbers], dtype=np.float64)
        for name in names
    }
    kept = [name for name, column in columns.items() if _varies(column[:, 0])]
    tests = sum(int(np.isfinite(columns[name][:, 0]).sum()) for name in kept)
    units = {name: unit for own in numbers for name, (_, _, unit) in own.items()}
    groups = {
        factor: np.array(labels)
        for factor, labels in factors.items()
        if len(set(labels) - {""}) > 1
    }
    return tuple(
        _chart(name, units[name], columns[name], groups, alpha / tests, len(kept)) for name in kept
    )


def _varies(values: Array) -> bool:
    known = values[np.isfinite(values)]
    return len(known) >= FEWEST and bool(np.ptp(known) > 0)


def _chart(
    name: str, unit: str, column: Array, groups: Mapping[str, NDArray], rate: float, count: int
) -> Chart:
    value, sigma = column.T
    above = name in QUALITY
    with np.errstate(divide="ignore", invalid="ignore"):
        scale, own = (np.log(value), sigma / value) if above else (value, sigma)
    scale = np.where(np.isfinite(scale), scale, np.nan)
    middle = np.full(len(scale), np.nanmedian(scale))
    factor, p_value = _apart(scale, groups)
    batches: tuple[Batch, ...] = ()
    if p_value < APART / (count * max(1, len(groups))):
        found = {
            label: scale[(groups[factor] == label) & np.isfinite(scale)]
            for label in sorted(set(groups[factor]) - {""})
        }
        centres = {
            label: float(np.median(own)) for label, own in found.items() if len(own) >= FEWEST
        }
        middle = np.array([centres.get(label, np.nanmedian(scale)) for label in groups[factor]])
        batches = tuple(
            Batch(label, float(np.exp(c) if above else c), len(found[label]))
            for label, c in centres.items()
        )
    off = scale - middle
    known = np.isfinite(off)
    spread = SIGMA * float(np.median(np.abs(off[known])))
    usual = float(np.median(own[known] ** 2))
    each = np.sqrt(spread**2 + np.maximum(0.0, own**2 - usual))
    with np.errstate(divide="ignore", invalid="ignore"):
        spreads = np.where(off == 0, 0.0, np.clip(off / each, -FARTHEST, FARTHEST))
    threshold = float(
        t.isf(rate if above else rate / 2, max(1.0, EFFICIENCY * (int(known.sum()) - 1)))
    )
    centre = np.exp(middle) if above else middle
    return Chart(
        name,
        unit,
        value,
        sigma,
        centre,
        spread,
        spreads,
        threshold,
        factor if batches else "",
        batches,
        p_value,
    )


def _apart(scale: Array, groups: Mapping[str, NDArray]) -> tuple[str, float]:
    """The factor whose batches differ most, and the p-value of that."""
    found: dict[str, float] = {}
    for factor, labels in groups.items():
        batches = [
            scale[(labels == label) & np.isfinite(scale)] for label in set(labels.tolist()) - {""}
        ]
        batches = [batch for batch in batches if len(batch) >= FEWEST]
        if len(batches) > 1 and np.ptp(np.concatenate(batches)) > 0:
            found[factor] = float(kruskal(*batches).pvalue)
    return min(found.items(), key=lambda item: item[1], default=("", 1.0))
