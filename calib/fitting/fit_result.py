"""A calibration with the result of another fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.calibration_content import AddedEffect, Stage
from calib.corners.view import pose_labels
from calib.effects.effect import Effect
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import Estimate, JointFit
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.estimation.stated_priors import with_estimates
from calib.fit_record.outcome import JointOutcome, Uncertainty
from calib.fitting.differing import possible_shifts
from calib.fitting.valleys import widen_valleys, with_variance
from calib.inference.board_bend import possible_print_shifts
from calib.inference.effect_context import effect_context
from calib.inference.fitted_model import FittedModel
from calib.inference.view_scatter import ViewScatter
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.numbers import unknown_names
from calib.session.parameter_names import CAMERA

SCATTERED = 1.25
"""The scatter of the views over that of independent corners, from which on it is asked whether
numbers differ from view to view. Noise alone gives 0.8 to 1.2.
"""
SCATTERED_POINTS = 2.0
"""The same of a target of points, whose systematic errors of 0.002 px scatter by 1.4."""
MAX_VIEWS = 500
"""The largest number of views of which it is asked: time and memory grow with its square."""
EFFECTS_STAGE = "cover+rbf+effects"
LOOSE = 3.0
"""The stated standard deviation over the usual tolerance, above which a number of the cover is as
good as unknown: the lens may make up for it along a curved valley.
"""
HEAVY = 0.1
"""The part of what all views tell from which a view that tells so much is listed, or twice its
fair part where the views are few.
"""


def with_fit(
    calibration: Calibration, model: CameraModel, joint: JointFit, observations: Observations
) -> Calibration:
    """Return the calibration with the parameters and effects of another joint fit, and the
    record of that fit.
    """
    declared = calibration.declared
    loose = loose_names(declared.intrinsics, declared.cover)
    labels = pose_labels(calibration.views)
    reported, uncertainty = count_views(
        model, observations, joint, labels, calibration.board, calibration.camera, loose
    )
    estimated = with_estimate(calibration, model, reported, observations)
    outcome = replace(calibration.outcome, joint=JointOutcome.of(joint), uncertainty=uncertainty)
    return replace(estimated, outcome=outcome)


def loose_names(intrinsics: Intrinsics, cover: Cover) -> tuple[str, ...]:
    """Return the names of the numbers that are unknown, and of those of the cover that are declared
    far more loosely than usual.
    """
    kinds, unknown = cover.dimensions, unknown_names(intrinsics, cover)
    loose = [
        name
        for name, number in cover.numbers.items()
        if (usual := kinds[name].tolerance) and number.sigma > LOOSE * usual.sigma
    ]
    return tuple(dict.fromkeys((*unknown, *loose)))


def count_views(
    model: CameraModel,
    observations: Observations,
    joint: JointFit,
    labels: NDArray[np.int64],
    board: Board,
    camera: Camera,
    loose: Sequence[str] = (),
) -> tuple[JointFit, Uncertainty]:
    """Return the fit with a covariance that counts views and corners of the board, and how it
    counts them. Where views scatter, it has the shift by numbers that seem to differ from view to
    view, too.

    Args:
        loose: the names of the numbers with wide priors. None becomes less certain than its prior,
            which is no measurement that scatters with the views.
    """
    fitted = FittedModel(model, observations, joint)
    scatter = ViewScatter.of(fitted, labels)
    poses = len(np.unique(labels))
    heavy = max(HEAVY, 2 / poses)
    uncertainty = Uncertainty(
        poses,
        scatter.inflation,
        scatter.ratio,
        scatter.corner_ratio,
        {
            observations.names[int(np.argmax(labels == label))]: float(share)
            for label, share in enumerate(scatter.shares)
            if share > heavy
        },
    )
    of_cover = [name for name in loose if not CAMERA.has(name)]
    wide = scatter.widen(joint)
    if board.has_grid and joint.finite:
        shifts = possible_print_shifts(fitted, board, scatter.inflation)
        wide = replace(wide, covariance=wide.covariance + torch.from_numpy(shifts))
    limit = SCATTERED if board.has_grid else SCATTERED_POINTS
    if scatter.ratio > limit and len(labels) <= MAX_VIEWS:
        context = effect_context(fitted, board, camera, locate=False)
        shifts = possible_shifts(fitted, context)
        wide = replace(wide, covariance=wide.covariance + torch.from_numpy(shifts))
    wide, variances = widen_valleys(model, observations, joint, wide, of_cover)
    limited = _limited_by_priors(wide, loose)
    # A limit takes from whatever depends on its number, perhaps more than that number's profile.
    return _limited_by_priors(_at_least(limited, variances), loose), uncertainty


def _at_least(joint: JointFit, variances: Mapping[str, float]) -> JointFit:
    """Return the fit with at least these variances, over the scales squared, each no larger than
    that of the number's prior.
    """
    covariance = joint.covariance
    for name, variance in variances.items():
        at, limit = _place_and_limit(joint, name)
        if float(covariance[at, at]) < min(variance, limit):
            covariance = with_variance(covariance, at, min(variance, limit))
    return replace(joint, covariance=covariance)


def _place_and_limit(joint: JointFit, name: str) -> tuple[int, float]:
    """Return the place of a scalar in the fitted vector, and the variance of its prior over its
    scale squared.
    """
    scale = next(param.scale for param in joint.parameters.free if param.name == name)
    limit = (float(joint.parameters.priors.sigmas[name]) / scale) ** 2
    return joint.parameters.slices()[name].start, limit


def _limited_by_priors(joint: JointFit, names: Sequence[str]) -> JointFit:
    """Return the fit with a covariance in which none of these numbers is less certain than its
    prior: each that is gets an observation that makes it as certain, and whatever depends on it
    follows.
    """
    if not joint.finite:
        return joint
    covariance = joint.covariance
    for param in joint.parameters.free:
        if param.name in names:
            at, limit = _place_and_limit(joint, param.name)
            if float(covariance[at, at]) > limit:
                covariance = with_variance(covariance, at, limit)
    return replace(joint, covariance=covariance)


def with_estimate(
    calibration: Calibration, model: CameraModel, estimate: Estimate, observations: Observations
) -> Calibration:
    """Return the calibration with the parameters and effects of another estimate."""
    assert calibration.camera.intrinsics
    intrinsics, cover = with_estimates(calibration.camera.intrinsics, calibration.cover, estimate)
    effects = added_effects(model.effects, estimate)
    residual = residuals(model.path, estimate.values, observations, estimate.poses)
    stages = tuple(stage for stage in calibration.stages if stage.name != EFFECTS_STAGE)
    return replace(
        calibration,
        camera=replace(calibration.camera, intrinsics=intrinsics),
        cover=cover,
        relief=model.path.settled_relief(estimate.values),
        amplitudes=(
            estimate.values["relief.amplitudes"].numpy()
            if calibration.relief
            else calibration.amplitudes
        ),
        poses=estimate.poses.numpy(),
        covariance=estimate.saved_covariance,
        effects=effects,
        stages=(*stages, Stage(EFFECTS_STAGE, residual.rms_px, residual.rmse_cm))
        if effects
        else stages,
    )


def added_effects(effects: Sequence[Effect], estimate: Estimate) -> tuple[AddedEffect, ...]:
    """Return the effects of a model with their estimated parameters."""
    return tuple(
        AddedEffect(
            effect,
            {
                parameter.param.name: (
                    estimate.values[parameter.param.name].numpy(),
                    estimate.sigma_of(parameter.param.name).numpy(),
                )
                for parameter in effect.effect_parameters
            },
        )
        for effect in effects
    )
