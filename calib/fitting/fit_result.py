"""A calibration with the result of another fit."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from operator import gt, lt

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
from calib.inference.board_bend import possible_print_shifts, possible_prints
from calib.inference.effect_context import effect_context
from calib.inference.fitted_model import MAX_VIEWS, FittedModel
from calib.inference.view_scatter import ViewScatter
from calib.session.board import Board
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.numbers import unknown_names
from calib.session.parameter_names import CAMERA, number_of

SCATTERED = 1.25
"""The scatter of the views over that of independent corners, from which on it is asked whether
numbers differ from view to view. Noise alone gives 0.8 to 1.2.
"""
SCATTERED_POINTS = 2.0
"""The same of a target of points, whose systematic errors of 0.002 px scatter by 1.4."""
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
    averages: Observations | None = None,
) -> tuple[JointFit, Uncertainty]:
    """Return the fit with a covariance that counts views and corners of the board, and how it
    counts them. Where views scatter, it has the shift by numbers that seem to differ from view to
    view, too.

    Args:
        loose: the names of the numbers with wide priors, of which the profile is asked as well.
        averages: the averages of the corners, if they are known.
    """
    fitted = FittedModel(model, averages or observations, joint)
    if joint.finite:
        fitted = fitted.averaged()
    prints = possible_prints(fitted, board)
    views = [view.reduce() for view in fitted.equations(prints)] if joint.finite else []
    scatter = ViewScatter.of(fitted, labels, views)
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
    if prints and joint.finite:
        shifts = possible_print_shifts(fitted, board, scatter.inflation, views)
        wide = replace(wide, covariance=wide.covariance + torch.from_numpy(shifts))
    limit = SCATTERED if board.has_grid else SCATTERED_POINTS
    if scatter.ratio > limit and len(labels) <= MAX_VIEWS:
        context = effect_context(fitted, board, camera, locate=False)
        shifts = possible_shifts(fitted, context)
        wide = replace(wide, covariance=wide.covariance + torch.from_numpy(shifts))
    wide, variances = widen_valleys(model, fitted.observations, joint, wide, of_cover)
    if not joint.finite:
        return wide, uncertainty
    limits = _limits_by_priors(joint)
    limited = _with_variances(wide, limits, lt)
    # A limit takes from whatever depends on its number, perhaps more than that number's profile.
    minima = {name: min(variance, limits[name]) for name, variance in variances.items()}
    widened = _with_variances(limited, minima, gt)
    return _with_variances(widened, limits, lt), uncertainty


def _limits_by_priors(joint: JointFit) -> Mapping[str, float]:
    """Return by its name the largest variance of each declared number, over its scale squared: that
    of the prior, or the square of the distance from its mean if this is larger.
    """
    sigmas = joint.parameters.priors.sigmas
    limits = {}
    for param in joint.parameters.free:
        name = param.name
        if name in sigmas and not param.shape and (CAMERA.has(name) or number_of(name)):
            shift = float(joint.values[name] - joint.parameters.origin[name])
            limits[name] = (max(float(sigmas[name]), abs(shift)) / param.scale) ** 2
    return limits


def _with_variances(
    joint: JointFit, variances: Mapping[str, float], replaces: Callable[[float, float], bool]
) -> JointFit:
    """Return the fit with these variances, over the scales squared, where `replaces(new, old)`:
    whatever depends on such a number follows.
    """
    covariance, places = joint.covariance, joint.parameters.slices()
    for name, variance in variances.items():
        at = places[name].start
        if replaces(variance, float(covariance[at, at])):
            covariance = with_variance(covariance, at, variance)
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
