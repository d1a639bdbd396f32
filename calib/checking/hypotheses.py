"""The evidence of every candidate explanation of the checked corners.

Each candidate change is fitted to the checked views, with the calibration's covariance as the prior
of everything else. The marginal likelihoods are compared at equal prior odds, as in the diagnosis.
Two candidates have no named cause: a single bad view, and an unknown change, of which only a larger
error is assumed.

Source: R. E. Kass, A. E. Raftery, Bayes factors (1995).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.checking.cover_spin import CoverSpin
from calib.checking.picture_mode import PictureMode
from calib.checking.posterior_predictive import PosteriorPredictive, prior_spread
from calib.checking.prior import CalibrationPrior
from calib.checking.refit import refit
from calib.effects.effect import Effect, log_bayes_factor
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses
from calib.estimation.residuals import Residuals
from calib.session.shapes.layer import AIR, MEDIA, WATER, medium_word
from calib.verdict.orientation import ALL as ORIENTATIONS

Array = NDArray[np.float64]

GROSS = 2.0
"""The error over the noise above which the first order is not trusted: every candidate is fitted,
and other picture modes are tried.
"""
FAR_ABOVE_NOISE = 10.0
"""The error over the noise from which a change that explains it must halve it at least."""
TURNED = "turned_pictures"
UNCOVERED = "no_cover"
OTHER_MEDIUM = "other_medium"
FORGOTTEN = (
    "these pictures look as if there was no cover: put it back, and take them again, or check that"
    " they are of this camera"
)
FORGOTTEN_IN_WATER = (
    "these pictures look as if there was no cover, and the calibration is for water: take them"
    " under water, through the cover, or check that they are of this camera"
)
IMMERSED = {
    WATER: "the pictures were taken under water, and the calibration is for air:"
    f" `calib immerse CALIBRATION --outside-index {MEDIA[WATER]:g}`, with the calibration that"
    " was checked, makes one for water",
    AIR: "the pictures were taken in air, and the calibration is for water:"
    f" `calib immerse CALIBRATION --outside-index {MEDIA[AIR]:g}`, with the calibration that was"
    " checked, makes one for air",
}
OTHER_CAMERA = "other_camera"
ANOTHER = (
    "the pictures are of another camera or through another cover: this one would have to have"
    " changed by more than is possible"
)
POSSIBLE_SIGMAS = 10.0
"""The largest change of a number, in standard deviations of its prior: a cover that is 20 mm beside
its place, or a focal length that is 20 % longer, is no change of one camera.
"""
UNBOUNDED = (CoverSpin, PictureMode)
"""Changes that may have any size: of how a round cover is screwed on, and of the pictures."""
UNKNOWN = (
    "none of the causes that this check considers explains the change: record a session as it is"
    " now, and fit it"
)


@dataclass(frozen=True, slots=True, eq=False)
class Hypothesis:
    """A candidate explanation with its evidence."""

    name: str
    log_evidence: float
    change: Effect | None = None
    vector: Array = field(default_factory=lambda: np.zeros(0))
    """(k,) the change's parameters over their scales."""
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    """(k, k) the covariance of `vector`."""
    residuals: Residuals | None = None
    """The residuals of the fit; None for a candidate that was not fitted."""
    words: str = ""
    view: int = -1
    """The index of a bad view."""


@dataclass(frozen=True, slots=True, eq=False)
class CheckedViews:
    """The views of a check, linearised at the calibration."""

    observations: Observations
    poses: Tensor
    """(V, B) through the calibration."""
    predictive: PosteriorPredictive
    width: int
    height: int


def rank_hypotheses(
    prior: CalibrationPrior,
    changes: Sequence[Effect],
    views: CheckedViews,
    sigma: float,
    error: float,
) -> list[Hypothesis]:
    """Return all explanations, the most probable first, with their evidence relative to a valid
    calibration.

    Args:
        sigma: the noise of the corners in these pictures, px per axis.
        error: the error of the calibration in px.
    """
    variance = (sigma / prior.sigma) ** 2
    products = views.predictive.normalised_products() / variance
    if error > GROSS * 2**0.5 * prior.sigma:
        fits = [
            _fit_mode(prior, change, views, sigma, error)
            if isinstance(change, PictureMode)
            else _fit_change(prior, change, views, sigma)
            for change in changes
        ]
        candidates = [fit for fit in fits if fit and _explains(fit, error, sigma)]
        ranking = [_relative(candidate, products) for candidate in candidates]
    else:
        ranking = [_first_order(change, products, views.predictive) for change in changes]
    whole_pictures = (
        *_turned(prior, views, sigma),
        *_uncovered(prior, views, sigma),
        *_in_other_medium(prior, views, sigma, error),
    )
    ranking += [_relative(candidate, products) for candidate in whole_pictures]
    evidence = variance_evidence(products[0, 0], views.predictive.freedom.sum())
    ranking.append(Hypothesis("unknown", evidence, words=UNKNOWN))
    ranking = [_bounded(hypothesis) for hypothesis in ranking]
    ranking += _bad_views(views, variance)
    return sorted(ranking, key=lambda hypothesis: -hypothesis.log_evidence)


def _explains(fit: Hypothesis, error: float, sigma: float) -> bool:
    """Return False for a change that leaves most of an error far above the noise: its evidence is
    then an extrapolation of the first order.
    """
    residual = fit.residuals.rms_px if fit.residuals else 0.0
    return error < FAR_ABOVE_NOISE * 2**0.5 * sigma or residual < error / 2


def _bounded(hypothesis: Hypothesis) -> Hypothesis:
    """Return the hypothesis of another camera or cover in place of a change that is impossible."""
    change = hypothesis.change
    if change is None or isinstance(change, UNBOUNDED):
        return hypothesis
    if np.abs(hypothesis.vector / prior_spread(change)).max(initial=0.0) <= POSSIBLE_SIGMAS:
        return hypothesis
    return replace(
        hypothesis,
        name=OTHER_CAMERA,
        change=None,
        vector=np.zeros(0),
        covariance=np.zeros((0, 0)),
        words=ANOTHER,
    )


def _relative(hypothesis: Hypothesis, products: Array) -> Hypothesis:
    """Return the hypothesis with its evidence relative to a valid calibration."""
    log_evidence = hypothesis.log_evidence + float(products[0, 0]) / 2
    return replace(hypothesis, log_evidence=log_evidence)


def _first_order(change: Effect, products: Array, predictive: PosteriorPredictive) -> Hypothesis:
    """Estimate a change to first order; `products` are inner products over the noise variance."""
    columns = predictive.columns(change.name)
    spread = prior_spread(change)
    information = products[columns, columns]
    score = products[columns, 0]
    covariance = np.asarray(np.linalg.inv(information + np.diag(spread**-2.0)), np.float64)
    evidence = log_bayes_factor(information, score, spread)
    return Hypothesis(change.name, evidence, change, -covariance @ score, covariance)


def _fit_change(
    prior: CalibrationPrior,
    change: Effect,
    views: CheckedViews,
    sigma: float,
    poses: Tensor | None = None,
    start: dict[str, Tensor] | None = None,
) -> Hypothesis | None:
    """Fit a change alone, then, to first order around that fit, together with the uncertainty of
    the calibration.

    The evidence is absolute. Returns None if there is no such fit.
    """
    start_poses = views.poses if poses is None else poses
    try:
        fit = refit(
            prior, change, views.observations, start_poses, sigma, start=start, change_only=True
        )
    except ValueError:  # no corner is visible at the start
        return None
    if not fit.finite:
        return None
    predictive = PosteriorPredictive.of(prior, (change,), views.observations, fit.poses, fit.values)
    products = predictive.normalised_products() * (prior.sigma / sigma) ** 2
    columns = predictive.columns(change.name)
    spread = prior_spread(change)
    information = products[columns, columns]
    score = products[columns, 0]
    covariance = np.asarray(np.linalg.inv(information + np.diag(spread**-2.0)), np.float64)
    fitted = fit.shared.numpy()
    vector = covariance @ (information @ fitted - score)
    step = vector - fitted
    prior_cost = float(((vector / spread) ** 2).sum())
    cost = products[0, 0] + 2 * score @ step + step @ information @ step + prior_cost
    occam = np.linalg.slogdet(np.eye(len(spread)) + spread[:, None] * information * spread)[1]
    return Hypothesis(
        name=change.name,
        log_evidence=-float(cost + occam) / 2,
        change=change,
        vector=vector,
        covariance=covariance,
        residuals=fit.residuals(views.observations),
    )


def variance_evidence(squares: float, freedom: float) -> float:
    """Return the evidence of an error of any form: the variance of the corners is estimated, at the
    cost of one parameter.
    """
    ratio = squares / freedom
    gain = freedom / 2 * (ratio - 1 - np.log(ratio)) if ratio > 1 else 0.0
    return float(gain - np.log(freedom) / 2)


def _bad_views(views: CheckedViews, variance: float) -> list[Hypothesis]:
    """Return a hypothesis for each view: its variance is estimated, and the calibration holds for
    the other views.
    """
    predictive = views.predictive
    indices = np.arange(len(views.observations.names))
    if len(indices) < 2:
        return []
    squares = predictive.normalised_products()[0, 0]
    log_determinant = predictive.log_determinant(indices)
    hypotheses = []
    for view in indices:
        good_views = indices[indices != view]
        decrease = (squares - predictive.normalised_products(good_views)[0, 0]) / variance
        gain = (decrease + log_determinant - predictive.log_determinant(good_views)) / 2
        view_squares = float(predictive.products[view, 0, 0]) / variance
        hypotheses.append(_bad_view(views, int(view), gain, view_squares))
    return hypotheses


def _bad_view(views: CheckedViews, view: int, gain: float, squares: float) -> Hypothesis:
    """Return the hypothesis that one view is bad.

    Args:
        gain: half of the decrease of the sum of squares without the view.
        squares: the view's own sum of squares, over the noise variance.
    """
    name = views.observations.names[view]
    freedom = float(views.predictive.freedom[view])
    evidence = gain - freedom / 2 * (1 + np.log(max(1.0, squares / freedom)))
    return Hypothesis(
        name="bad_view",
        log_evidence=float(evidence - np.log(freedom) / 2 - np.log(len(views.observations.names))),
        words=f"{name} alone does not fit: the board or the camera moved, or it is blurred",
        view=view,
    )


def _fit_mode(
    prior: CalibrationPrior, mode: PictureMode, views: CheckedViews, sigma: float, error: float
) -> Hypothesis | None:
    """Fit another picture mode, starting from the best of its usual scales."""
    path = prior.model.with_effect(mode).path
    starts: list[tuple[float, dict[str, Tensor], Tensor]] = [(error, {}, views.poses)]
    for factor, numbers in mode.starts():
        start = {
            name: torch.tensor(number, dtype=torch.float64) for name, number in numbers.items()
        }
        values = {**prior.model.means, **prior.model.neutral_values(mode), **start}
        observations = views.observations
        pixels, _ = path.adjustments[0](observations.pixels, values, observations.exposure)
        observations = replace(observations, pixels=pixels)
        if (fit := _fit_poses(prior, observations)) is not None:
            poses, residuals = fit
            starts.append((residuals.rms_px / factor, start, poses))
    _, start, poses = min(starts, key=lambda candidate: candidate[0])
    return _fit_change(prior, mode, views, sigma, poses, start)


def _turned(prior: CalibrationPrior, views: CheckedViews, sigma: float) -> list[Hypothesis]:
    """Return a hypothesis for each way in which pictures of this size can be turned or mirrored."""
    hypotheses = []
    for orientation in ORIENTATIONS[1:]:
        if orientation.quarters % 2 and views.width != views.height:
            continue
        observations = orientation.apply(views.observations, views.width, views.height)
        if (fit := _fit_poses(prior, observations)) is not None:
            poses, residuals = fit
            words = f"the pictures come from another mode: {orientation}, they fit"
            predictive = PosteriorPredictive.of(prior, (), observations, poses)
            evidence = _fixed_evidence(prior, predictive, sigma)
            hypotheses.append(Hypothesis(TURNED, evidence, residuals=residuals, words=words))
    return hypotheses


def _uncovered(prior: CalibrationPrior, views: CheckedViews, sigma: float) -> list[Hypothesis]:
    """Return the hypothesis that the cover is absent, for a camera that has one.

    Glass of no thickness would explain it as well, but does not exist.
    """
    if not prior.model.path.cover:
        return []
    index = float(prior.model.means[prior.model.path.cover[-1].index_outside])
    words = FORGOTTEN_IN_WATER if medium_word(index) == WATER else FORGOTTEN
    return _through(prior.uncovered(), views, sigma, UNCOVERED, words)


def _in_other_medium(
    prior: CalibrationPrior, views: CheckedViews, sigma: float, error: float
) -> list[Hypothesis]:
    """Return the hypothesis that camera and cover are the same, but under water or in air, if that
    alone halves the error.

    What the other medium would make visible is known so badly that it could imitate anything.
    """
    if not (other := prior.in_other_medium):
        return []
    index = float(other.model.means[other.model.path.cover[-1].index_outside])
    hypotheses = _through(other, views, sigma, OTHER_MEDIUM, IMMERSED[medium_word(index)])
    return [fit for fit in hypotheses if fit.residuals and fit.residuals.rms_px < error / 2]


def _through(
    prior: CalibrationPrior, views: CheckedViews, sigma: float, name: str, words: str
) -> list[Hypothesis]:
    """Return the hypothesis that the views were taken through another prior, if they have poses.

    A prior that predicts the corners less sharply than the calibration does pays for it.
    """
    if (fit := _fit_poses(prior, views.observations)) is None:
        return []
    poses, residuals = fit
    predictive = PosteriorPredictive.of(prior, (), views.observations, poses)
    indices = np.arange(len(views.observations.names))
    spread = predictive.log_determinant(indices) - views.predictive.log_determinant(indices)
    evidence = _fixed_evidence(prior, predictive, sigma) - spread / 2
    return [Hypothesis(name, evidence, residuals=residuals, words=words)]


def _fixed_evidence(
    prior: CalibrationPrior, predictive: PosteriorPredictive, sigma: float
) -> float:
    """Return the evidence of a hypothesis without parameters."""
    squares = predictive.normalised_products()[0, 0]
    return -float(squares * (prior.sigma / sigma) ** 2) / 2


def _fit_poses(
    prior: CalibrationPrior, observations: Observations
) -> tuple[Tensor, Residuals] | None:
    """Return fitted poses and residuals; None if a view has no pose."""
    poses = pinhole_poses(prior.model.path, prior.model.means, observations)
    if not bool(torch.isfinite(poses).all()):
        return None
    poses, residuals = prior.fit_poses(observations, poses)
    return (poses, residuals) if np.isfinite(residuals.rms_px) else None
