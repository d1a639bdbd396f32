"""Mean reprojection errors by place. Noise has mean zero everywhere, so a mean that is too large
for noise is a pattern.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtrc

from calib.fitting.corner_range import CELLS
from calib.report.evidence import Array, Evidence

CHANCE = 0.01
"""The probability that noise alone makes the mean of a group significant."""
CHI2_LIMIT = float(-np.log(CHANCE))
"""The squared length of a two-dimensional mean over its expectation, which noise exceeds with
probability CHANCE.
"""
PATTERN_PROBABILITY = 0.01
"""Significant means are a pattern if noise alone makes as many with less than this probability."""


@dataclass(frozen=True, slots=True)
class GroupMeans:
    """Mean reprojection errors of G groups of corners."""

    mean: Array
    """(G, 2) px, NaN in a group without corners."""
    length: Array
    """(G,) px"""
    significant: NDArray[np.bool_]
    """(G,) true where noise does not explain the length."""

    @staticmethod
    def of(evidence: Evidence, group: NDArray[np.int64], groups: int) -> GroupMeans:
        """Average by group; `group` is (M,), the group of each corner."""
        errors, visible = evidence.errors, np.isfinite(evidence.errors).all(-1)
        count = np.bincount(group[visible], minlength=groups)
        sums = np.stack(
            [np.bincount(group[visible], errors[visible, axis], groups) for axis in (0, 1)], -1
        )
        mean = np.where(count[:, None] > 0, sums / np.maximum(count, 1)[:, None], np.nan)
        length = np.linalg.norm(mean, axis=-1)
        noise = evidence.calibration.noise_px
        limit = np.inf if noise is None else CHI2_LIMIT * noise**2
        return GroupMeans(mean, length, length**2 * count > limit)

    @property
    def judged(self) -> int:
        """The number of groups with corners."""
        return int(np.isfinite(self.length).sum())

    @property
    def probability(self) -> float:
        """The probability that noise alone makes as many groups significant, or more: the tail of
        the binomial distribution.
        """
        return float(bdtrc(int(self.significant.sum()) - 1, self.judged, CHANCE))

    @property
    def is_pattern(self) -> bool:
        """True if more groups are significant than noise explains."""
        return self.probability < PATTERN_PROBABILITY

    @property
    def summary(self) -> str:
        """Text for captions: the number of significant groups, that expected of noise, and how
        often noise makes as many if they are more than expected and still no pattern.
        """
        count, expected = int(self.significant.sum()), CHANCE * self.judged
        words = "a pattern" if self.is_pattern else "no pattern"
        compared = f"{count} of {self.judged} places deviate; noise alone"
        if self.is_pattern or count <= expected:
            return f"{words} ({compared} makes {expected:.1f})"
        return f"{words} ({compared} makes as many in {100 * self.probability:.2g} % of sessions)"


def over_image(evidence: Evidence) -> GroupMeans:
    """Average by cell of the image, row by row."""
    return GroupMeans.of(evidence, evidence.cell, CELLS[0] * CELLS[1])


def over_board(evidence: Evidence) -> GroupMeans:
    """Average by corner of the board."""
    return GroupMeans.of(evidence, evidence.corner, evidence.calibration.board.count)
