"""Mean reprojection errors by place: noise has no mean anywhere, so a mean that noise does not
explain is a pattern.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.report.evidence import CELLS, Array, Evidence

CHANCE = 0.01
"""How often noise alone makes a mean that counts as beyond noise."""
UNLIKELY = float(-np.log(CHANCE))
"""Squared length of a two-dimensional mean over its expectation, which noise exceeds with that
chance.
"""
PATTERN = 0.1
"""Of the groups with corners: more of them beyond noise make a pattern."""


@dataclass(frozen=True, slots=True)
class Means:
    """Of G groups of corners."""

    mean: Array
    """(G, 2) px, NaN in a group without corners."""
    length: Array
    """(G,) px"""
    beyond: NDArray[np.bool_]
    """(G,) longer than noise makes them."""

    @staticmethod
    def of(evidence: Evidence, group: NDArray[np.int64], groups: int) -> Means:
        """Args: group: (M,) of each corner."""
        errors, seen = evidence.errors, np.isfinite(evidence.errors).all(-1)
        count = np.bincount(group[seen], minlength=groups)
        total = np.stack(
            [np.bincount(group[seen], errors[seen, axis], groups) for axis in (0, 1)], -1
        )
        mean = np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan)
        length = np.linalg.norm(mean, axis=-1)
        return Means(mean, length, length**2 * count > UNLIKELY * evidence.calibration.noise_px**2)

    @property
    def judged(self) -> int:
        """Groups with corners."""
        return int(np.isfinite(self.length).sum())

    @property
    def is_pattern(self) -> bool:
        return bool(self.beyond.sum() > PATTERN * self.judged)

    @property
    def said(self) -> str:
        return (
            f"{self.beyond.sum()} of {self.judged}, where chance gives {CHANCE * self.judged:.1f}"
        )


def over_image(evidence: Evidence) -> Means:
    """By cell of the image, row by row."""
    return Means.of(evidence, evidence.cell, CELLS[0] * CELLS[1])


def over_board(evidence: Evidence) -> Means:
    """By corner of the board."""
    corner = np.concatenate([np.flatnonzero(view.seen) for view in evidence.calibration.views])
    return Means.of(evidence, corner, evidence.calibration.board.count)
