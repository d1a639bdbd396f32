"""The evidence of every explanation of later placements of a rig's board: a camera that moved, one
that slipped between two placements, a camera whose own numbers changed, and a board that moved
between the pictures of one placement.

That a camera moved and that its own numbers changed have equal prior odds, divided among the ways
in which either can be; so have a slip and a board that moved, divided among the placements.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from calib.checking.hypotheses import UNKNOWN, variance_evidence
from calib.checking.posterior_predictive import PosteriorPredictive, prior_spread
from calib.effects.effect import Effect, log_bayes_factor
from calib.rig.placement_equations import LinearRig

SHIFT_SPREAD = 2e-3
"""m: the prior standard deviation of each component of a move. A camera that is knocked and still
sees the board moves by a millimetre or a few.
"""
TURN_SPREAD = 5e-3
"""rad: the same of a turn, a quarter of a degree. A few mm of play over a mount of several cm."""
KINDS = {
    "moved": slice(3, 6),
    "turned": slice(0, 3),
    "moved_and_turned": slice(0, 6),
}
"""The kinds of motions with their components: a rotation, then a translation."""
BAD_PLACEMENT = "bad_placement"
MIN_SLIP_PLACEMENTS = 3
"""The fewest placements from which a slip is told from a board that moved: two lie on one side."""

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class RigHypothesis:
    """A candidate explanation of the placements, with its evidence relative to an unchanged rig."""

    name: str
    """A kind of motion, the name of an effect, bad_placement, or unknown."""
    log_evidence: float
    camera: str = ""
    placement: int = -1
    """The first placement after a slip, or a bad placement; -1: all."""
    columns: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    """The (k,) columns of its numbers in the products."""
    vector: Array = field(default_factory=lambda: np.zeros(0))
    """(k,) the most probable numbers: rad and m, or over the scales of a change."""
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(k, k)"""
    change: Effect | None = None
    words: str = ""


def marginal(
    predictive: PosteriorPredictive, columns: NDArray[np.int64], placements: Mask | None = None
) -> tuple[Array, Array]:
    """Return the (k, k) information on numbers that act in some placements only, and their (k,)
    score, with the calibrated rig's uncertainty integrated out.
    """
    inner = slice(1, 1 + predictive.calibrated)
    total = predictive.products.sum(0)
    subset = total if placements is None else predictive.products[placements].sum(0)
    spread = np.eye(predictive.calibrated) + total[inner, inner]
    cross = subset[columns, inner]
    gain = np.linalg.solve(spread, np.column_stack([cross.T, total[inner, 0]]))
    information = subset[np.ix_(columns, columns)] - cross @ gain[:, :-1]
    return information, subset[columns, 0] - cross @ gain[:, -1]


def rank_rig_hypotheses(
    rig: LinearRig, predictive: PosteriorPredictive, movable: Sequence[str], scale: float
) -> list[RigHypothesis]:
    """Return all explanations, the most probable first.

    Args:
        movable: the cameras whose motion the placements tell.
        scale: the variance of the residuals over the predicted one, at least 1.
    """
    count = len(predictive.products)
    ranking = [
        _motion(rig, predictive, scale, camera, kind, odds=len(KINDS))
        for camera in movable
        for kind in KINDS
    ]
    slips = count - 2 if count >= MIN_SLIP_PLACEMENTS else 0
    for first in range(1, 1 + slips):
        later = np.arange(count) >= first
        ranking += [
            _motion(rig, predictive, scale, camera, kind, later, first, odds=slips * len(KINDS))
            for camera in movable
            for kind in KINDS
        ]
    if count > 1:
        for place in range(count):
            alone = np.arange(count) == place
            ranking += [
                _motion(rig, predictive, scale, camera, BAD_PLACEMENT, alone, place, odds=count)
                for camera in movable
            ]
    ranking += _own_changes(rig, predictive, scale)
    squares = marginal_square(predictive) / scale
    evidence = variance_evidence(squares, float(predictive.freedom.sum()))
    ranking.append(RigHypothesis("unknown", evidence, words=UNKNOWN))
    return sorted(ranking, key=lambda hypothesis: -hypothesis.log_evidence)


def marginal_square(predictive: PosteriorPredictive) -> float:
    """Return the squares of the residuals in the metric of their predicted covariance."""
    return float(predictive.normalised_products()[0, 0])


def _motion(
    rig: LinearRig,
    predictive: PosteriorPredictive,
    scale: float,
    camera: str,
    kind: str,
    placements: Mask | None = None,
    first: int = -1,
    odds: int = 1,
) -> RigHypothesis:
    columns = np.arange(6)[KINDS.get(kind, slice(0, 6))] + rig.columns()[camera].start
    spread = np.repeat([TURN_SPREAD, SHIFT_SPREAD], 3)[KINDS.get(kind, slice(0, 6))]
    return _fit(
        predictive,
        scale,
        kind,
        columns,
        spread,
        camera=camera,
        places=placements,
        first=first,
        odds=odds,
    )


def _own_changes(
    rig: LinearRig, predictive: PosteriorPredictive, scale: float
) -> Iterator[RigHypothesis]:
    places = rig.columns()
    for camera in rig.cameras:
        for change in rig.changes[camera.name]:
            place = places[f"{camera.name}.{change.name}"]
            yield _fit(
                predictive,
                scale,
                change.name,
                np.arange(place.start, place.stop),
                prior_spread(change),
                camera=camera.name,
                odds=len(rig.changes[camera.name]),
                change=change,
            )


def _fit(
    predictive: PosteriorPredictive,
    scale: float,
    name: str,
    columns: NDArray[np.int64],
    spread: Array,
    *,
    camera: str,
    places: Mask | None = None,
    first: int = -1,
    odds: int = 1,
    change: Effect | None = None,
) -> RigHypothesis:
    information, score = marginal(predictive, columns, places)
    information, score = information / scale, score / scale
    covariance = np.asarray(np.linalg.inv(information + np.diag(spread**-2.0)))
    return RigHypothesis(
        name=name,
        log_evidence=log_bayes_factor(information, score, spread) - float(np.log(odds)),
        camera=camera,
        placement=first,
        columns=columns,
        vector=-covariance @ score,
        covariance=covariance,
        change=change,
    )
