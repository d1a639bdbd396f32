"""Every candidate's evidence, given the corners, for what may have changed.

Each candidate is fitted to the checked views with the calibration's covariance as the prior of
everything else, and their marginal likelihoods are compared, equal odds beforehand, as the
diagnosis compares the rivals of an effect. Beside the changes that have a name
stand two that have none: that a single view is bad, and that it is something else, of which no more
    is assumed than that the error is
larger.

Source: R. E. Kass, A. E. Raftery, Bayes factors (1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.checking.equations import Equations, spread_of
from calib.checking.known import Known
from calib.checking.picture_mode import SCALES, PictureMode
from calib.checking.refit import refit
from calib.effects.effect import Effect, log_bayes_factor
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses
from calib.estimation.residuals import Residuals
from calib.verdict.orientation import ALL as ORIENTATIONS

Array = NDArray[np.float64]

GROSS = 2.0
"""Times the noise: from there on the first order says little: every candidate is fitted, and other
modes are tried.
"""
TURNED = "turned_pictures"
UNCOVERED = "no_cover"
FORGOTTEN = "the cover was not before the camera: put it back, and take them again"
UNKNOWN = "what has changed is none of the causes that are known here"


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """One explanation with its evidence."""

    name: str
    log_evidence: float
    change: Effect | None = None
    vector: Array = field(default_factory=lambda: np.zeros(0))
    """(k,) the change's parameters over their scales,"""
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(k, k) and their covariance."""
    missed: Residuals | None = None
    """What it leaves; None to first order."""
    words: str = ""
    view: int = -1
    """Of a bad one."""


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """The views that are checked."""

    observations: Observations
    poses: Tensor
    """(V, B) through the calibration."""
    equations: Equations
    width: int
    height: int


def hypotheses(
    known: Known, changes: Sequence[Effect], seen: Seen, sigma: float, error: float
) -> list[Hypothesis]:
    """All explanations, the most probable first; evidence is that against a valid calibration.

    Args:
        sigma: px per axis, of the corners of these pictures.
        error: px, what the calibration leaves.
    """
    variance = (sigma / known.sigma) ** 2
    together = seen.equations.predicted() / variance
    if error > GROSS * 2**0.5 * known.sigma:
        tried = [_fitted(known, change, seen, sigma) for change in changes]
        tried = [
            *(one for one in tried if one and one.name != PictureMode.name),
            _other_mode(known, changes, seen, sigma, error),
        ]
        found = [_against(one, together) for one in tried if one]
    else:
        found = [_first_order(change, together, seen.equations) for change in changes]
    found += [
        _against(one, together)
        for one in (*_turned(known, seen, sigma), *_uncovered(known, seen, sigma))
    ]
    found.append(
        Hypothesis(
            "unknown", _of_variance(together[0, 0], seen.equations.freedom.sum()), words=UNKNOWN
        )
    )
    found += _bad_views(seen, variance)
    return sorted(found, key=lambda one: -one.log_evidence)


def _against(one: Hypothesis, together: Array) -> Hypothesis:
    """With its evidence against that of a valid calibration."""
    return replace(one, log_evidence=one.log_evidence + float(together[0, 0]) / 2)


def _first_order(change: Effect, together: Array, equations: Equations) -> Hypothesis:
    """Args: together: inner products over the noise's variance."""
    own, spread = equations.columns(change.name), spread_of(change)
    information, score = together[own, own], together[own, 0]
    covariance = np.asarray(np.linalg.inv(information + np.diag(spread**-2.0)), np.float64)
    return Hypothesis(
        change.name,
        log_bayes_factor(information, score, spread),
        change,
        -covariance @ score,
        covariance,
    )


def _fitted(
    known: Known,
    change: Effect,
    seen: Seen,
    sigma: float,
    poses: Tensor | None = None,
    begin: dict[str, Tensor] | None = None,
) -> Hypothesis | None:
    """With the change as large as it shows itself, first by itself, then, to first order around
    that, beside what the calibration does not know. Its evidence is not yet against that of a valid
    calibration. None: there is no such fit.
    """
    start = seen.poses if poses is None else poses
    try:
        fit = refit(known, change, seen.observations, start, sigma, begin=begin, held=True)
    except ValueError:  # no corner is seen where it would begin
        return None
    if not fit.finite:
        return None
    equations = Equations.of(known, (change,), seen.observations, fit.poses, fit.values)
    together, own = (
        equations.predicted() * (known.sigma / sigma) ** 2,
        equations.columns(change.name),
    )
    information, score, spread = together[own, own], together[own, 0], spread_of(change)
    covariance = np.asarray(np.linalg.inv(information + np.diag(spread**-2.0)), np.float64)
    there = fit.shared.numpy()
    vector = covariance @ (information @ there - score)
    move = vector - there
    cost = (
        together[0, 0]
        + 2 * score @ move
        + move @ information @ move
        + float(((vector / spread) ** 2).sum())
    )
    narrowed = np.linalg.slogdet(np.eye(len(spread)) + spread[:, None] * information * spread)[1]
    return Hypothesis(
        change.name,
        -float(cost + narrowed) / 2,
        change,
        vector,
        covariance,
        fit.missed(seen.observations),
    )


def _of_variance(squares: float, freedom: float) -> float:
    """The evidence of an error of any form: the corners' variance is as large as it shows itself,
    for which one number is paid.
    """
    ratio = squares / freedom
    gain = freedom / 2 * (ratio - 1 - np.log(ratio)) if ratio > 1 else 0.0
    return float(gain - np.log(freedom) / 2)


def _bad_views(seen: Seen, variance: float) -> list[Hypothesis]:
    """One for each view, whose own variance is as large as it shows itself, while the others are as
    the calibration has them.
    """
    equations, every = seen.equations, np.arange(len(seen.observations.names))
    if len(every) < 2:
        return []
    squares, spread = equations.predicted()[0, 0], equations.log_determinant(every)
    found = []
    for view in every:
        rest = every[every != view]
        gain = (
            (squares - equations.predicted(rest)[0, 0]) / variance
            + spread
            - equations.log_determinant(rest)
        ) / 2
        found.append(
            _bad_view(seen, int(view), gain, float(equations.products[view, 0, 0]) / variance)
        )
    return found


def _bad_view(seen: Seen, view: int, gain: float, squares: float) -> Hypothesis:
    """Args: gain: half of what the others' sum of squares is smaller by without it; squares: its
    own, over the noise's variance.
    """
    name, freedom = seen.observations.names[view], float(seen.equations.freedom[view])
    evidence = gain - freedom / 2 * (1 + np.log(max(1.0, squares / freedom)))
    words = f"{name} alone does not fit: the board or the camera moved, or it is blurred"
    return Hypothesis(
        "bad_view",
        float(evidence - np.log(freedom) / 2 - np.log(len(seen.observations.names))),
        words=words,
        view=view,
    )


def _other_mode(
    known: Known, changes: Sequence[Effect], seen: Seen, sigma: float, error: float
) -> Hypothesis | None:
    """From the best of the modes that cameras have."""
    mode = next((change for change in changes if isinstance(change, PictureMode)), None)
    if not mode:
        return None
    path = known.model.with_effect(mode).path
    scale = mode.effect_parameters[0].param.name
    starts: list[tuple[float, dict[str, Tensor], Tensor]] = [(error, {}, seen.poses)]
    for factor in SCALES:
        begin = {scale: torch.tensor(np.log(factor), dtype=torch.float64)}
        values = {**known.model.means, **known.model.neutral_values(mode), **begin}
        moved = replace(
            seen.observations, pixels=path.adjustments[0](seen.observations.pixels, values)[0]
        )
        if (found := _posed(known, moved)) is not None:
            starts.append((found[1].rms_px / factor, begin, found[0]))
    _, begin, poses = min(starts, key=lambda one: one[0])
    return _fitted(known, mode, seen, sigma, poses, begin)


def _turned(known: Known, seen: Seen, sigma: float) -> list[Hypothesis]:
    """The ways in which a picture of the same size can be turned and mirrored."""
    found = []
    for way in ORIENTATIONS[1:]:
        if way.quarters % 2 and seen.width != seen.height:
            continue
        observations = way.apply(seen.observations, seen.width, seen.height)
        if (posed := _posed(known, observations)) is not None:
            cost = (
                Equations.of(known, (), observations, posed[0]).predicted()[0, 0]
                * (known.sigma / sigma) ** 2
            )
            words = f"the pictures come from another mode: {way}, they fit"
            found.append(Hypothesis(TURNED, -float(cost) / 2, missed=posed[1], words=words))
    return found


def _uncovered(known: Known, seen: Seen, sigma: float) -> list[Hypothesis]:
    """Without the cover, of a camera that has one: glass of no thickness would do as well, and
    nobody has any.
    """
    if not known.model.path.cover:
        return []
    bare = known.uncovered()
    if (posed := _posed(bare, seen.observations)) is None:
        return []
    cost = (
        Equations.of(bare, (), seen.observations, posed[0]).predicted()[0, 0]
        * (known.sigma / sigma) ** 2
    )
    return [Hypothesis(UNCOVERED, -float(cost) / 2, missed=posed[1], words=FORGOTTEN)]


def _posed(known: Known, observations: Observations) -> tuple[Tensor, Residuals] | None:
    """Poses and what they leave; None where a view has none."""
    poses = pinhole_poses(observations, known.model.means)
    if not bool(torch.isfinite(poses).all()):
        return None
    poses, missed = known.posed(observations, poses)
    return (poses, missed) if np.isfinite(missed.rms_px) else None
