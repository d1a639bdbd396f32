"""Which views were taken in air and which in water, if a session has both.

Water acts much unlike air, so the numbers of one fit to both are compromises. So each view is
compared through both media with the declared numbers, and then again with those of a fit to that
division.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.effects.refractive_index import RefractiveIndex
from calib.effects.varying import ALTERNATING, FROM_VIEW, Varying
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import Estimate
from calib.estimation.observations import Observations
from calib.estimation.poses import refine_poses_in_image, rough_poses
from calib.estimation.residuals import residuals
from calib.inference.fitted_model import FittedModel, ModelFit
from calib.inference.varying_numbers import MIN_BLOCK
from calib.inference.warm_start import rough_fit
from calib.optics.params import Values
from calib.session.parameter_names import COVER
from calib.session.shapes.layer import MEDIA, WATER, medium_word, opposite_medium

Flags = NDArray[np.bool_]
MAX_PASSES = 3
CLEAR = 0.5
"""The error of a view through one medium over that through the other from which it is clear which
one it was taken in.
"""
LIKELY = 0.7
"""The same ratio, from which a division of the views is tried."""
POSE_TOLERANCE = 0.01
"""The relative decrease of the cost at which poses are good enough to compare media."""


def fit_of_two_media(fitted: FittedModel, divisions: Sequence[Flags] = ()) -> ModelFit | None:
    """Return the best rough fit of the model with some views in air and the others in water; None
    without a division of the views.

    Args:
        divisions: (V,) flags each. Divisions of the views which may be that by the medium, either
            way round, beside that by which medium suits each view with the declared numbers.
    """
    if not _may_differ(fitted):
        return None
    stated = float(fitted.model.means[COVER.outside_index])
    start = _declared(fitted)
    sides = [side for division in divisions for side in (division, ~division)]
    if (suited := views_in_other_medium(fitted, LIKELY)) is not None:
        sides.append(suited)
    fits = [fit for side in sides if (fit := _fit(fitted, start, side))]
    if not fits:
        return None
    best = min(fits, key=lambda fit: fit.joint.cost)
    for _ in range(MAX_PASSES):
        effect = best.model.effects[-1]
        step_names = {parameter.param.name for parameter in effect.effect_parameters}
        values = {
            name: value for name, value in best.joint.values.items() if name not in step_names
        }
        start = replace(fitted.joint, values=values, poses=best.joint.poses)
        is_other = _in_other_medium(fitted, start, LIKELY)
        if is_other is None or _effect(is_other, stated) == effect:
            return best
        fit = _fit(fitted, start, is_other)
        if not fit or fit.joint.cost >= best.joint.cost:
            return best
        best = fit
    return best


def views_in_other_medium(fitted: FittedModel, ratio: float = CLEAR) -> Flags | None:
    """Return (V,) whether the medium that is not stated suits each view better, with the declared
    numbers; None without a cover, if indices differ already, or if in either medium fewer than
    MIN_BLOCK views have less than this ratio of their error in the other.
    """
    if not _may_differ(fitted):
        return None
    return _in_other_medium(fitted, _declared(fitted), ratio)


def _may_differ(fitted: FittedModel) -> bool:
    """Return True if there is a cover, and the model has no indices that differ yet."""
    names = {effect.name for effect in fitted.model.effects}
    return COVER.outside_index in fitted.model.means and RefractiveIndex.name not in names


def _declared(fitted: FittedModel) -> Estimate:
    """Return the fit with the declared numbers in place of its own."""
    return replace(fitted.joint, values=dict(fitted.model.means))


def _fit(fitted: FittedModel, start: Estimate, is_other: Flags) -> ModelFit | None:
    """Return a rough fit with these views in the other medium, if it is finite."""
    stated = float(fitted.model.means[COVER.outside_index])
    model = fitted.model.with_effect(_effect(is_other, stated))
    joint = rough_fit(model, fitted.observations, start)
    return ModelFit(model, joint) if joint.finite else None


def _in_other_medium(fitted: FittedModel, start: Estimate, ratio: float) -> Flags | None:
    """Return the same with the numbers of a start."""
    errors = _errors(fitted, start)
    is_other = errors[:, 1] < errors[:, 0]
    clear = errors.min(1) < ratio * errors.max(1)
    if min((is_other & clear).sum(), (~is_other & clear).sum()) < MIN_BLOCK:
        return None
    return is_other


def _effect(is_other: Flags, stated: float) -> Varying:
    step = 1.0 if opposite_medium(stated) == WATER else -1.0
    changes = np.count_nonzero(np.diff(is_other))
    return Varying(
        RefractiveIndex.name,
        FROM_VIEW if changes == 1 else ALTERNATING,
        (COVER.outside_index,),
        tuple((step * is_other).tolist()),
    )


def _errors(fitted: FittedModel, start: Estimate) -> NDArray[np.float64]:
    """Return (V, 2) px: the error of each view through the stated medium and the other."""
    stated = float(fitted.model.means[COVER.outside_index])
    index = start.values[COVER.outside_index]
    other_index = index + MEDIA[opposite_medium(stated)] - MEDIA[medium_word(stated)]
    columns = [
        _error_by_view(
            fitted.model,
            {**start.values, COVER.outside_index: medium},
            start,
            fitted.observations,
        )
        for medium in (index, other_index)
    ]
    return np.column_stack(columns)


def _error_by_view(
    model: CameraModel, values: Values, start: Estimate, observations: Observations
) -> NDArray[np.float64]:
    poses = model.pad_poses(start.poses)
    rough = rough_poses(model.path, values, observations)
    poses[:, :6] = torch.where(torch.isfinite(rough), rough, poses[:, :6])
    poses = refine_poses_in_image(
        model.path, values, observations, poses, sigma=start.sigma, tolerance=POSE_TOLERANCE
    ).blocks
    return residuals(model.path, values, observations, poses).view_errors(observations)
