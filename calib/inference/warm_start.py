"""Starting points of a fit that adds an effect to an earlier fit, or removes one.

Removing an effect: the parameters that remain take up what they can of it. The covariance of the
earlier fit says by how much, to first order: the mean of the remaining parameters, given that the
removed ones are neutral. From the plain end of the earlier fit, a lens whose other coefficients
must replace a removed one was often not found.

Adding an effect that does much from the start, such as water behind a window: the fit without it
has compensated for it. Boards stand a third nearer than they are, or the focal length is a third
longer, and some views have the wrong one of the two poses that a planar target has. A joint fit
from there ends in another local minimum, so the poses start anew through the new path.
"""

from dataclasses import replace

import torch
from torch import Tensor

from calib.estimation.camera_model import CameraModel
from calib.estimation.covariance import regression
from calib.estimation.joint_fit import ROUGH_ROUNDS, Estimate, JointFit, Start
from calib.estimation.observations import Observations
from calib.estimation.poses import refine_poses_in_image, rough_poses
from calib.estimation.residuals import residuals
from calib.estimation.view_equations import landing_problem
from calib.optics.params import Values

POSE_TOLERANCE = 0.03
"""The relative decrease of the cost at which the poses of a start are good enough; the fit
continues from there.
"""
START_VIEWS = 8
"""The number of views that choose among several starts."""


def start_without_effects(
    model: CameraModel, previous: CameraModel, joint: JointFit, observations: Observations
) -> Start:
    """Return the start of a fit of `model`, which has fewer or simpler effects than `previous`.

    Of two starts, with and without the correction by the covariance, it is the one with the smaller
    cost after the poses adapt.

    Args:
        joint: the fit of `previous`.
    """
    names = {param.name for param in model.parameters.free}
    removed = {
        name: value
        for effect in previous.effects
        for name, value in previous.neutral_values(effect).items()
        if name not in names
    }
    if not removed:
        return joint.start
    starts = [
        Start({**joint.values, **values}, joint.sigma, joint.smoothness)
        for values in ({}, _conditional_mean(joint, removed))
    ]
    return min(starts, key=lambda start: _cost(model, start, joint, observations))


def _conditional_mean(joint: JointFit, removed: Values) -> Values:
    """Return the means of all parameters, given the values of the removed ones."""
    parameters = joint.parameters
    names = [name for name in removed if name in parameters.slices()]
    entries = parameters.entries(names)
    if not len(entries):
        return {}
    vector = parameters.vector(joint.values)
    step = parameters.vector({**joint.values, **removed}) - vector
    by_removed = torch.from_numpy(regression(joint.covariance.numpy(), entries))
    mean = vector + by_removed @ step[entries]
    values = parameters.values(mean)
    return values | {
        param.name: values[param.name].clamp_min(param.minimum) for param in parameters.free
    }


def _cost(model: CameraModel, start: Start, joint: JointFit, observations: Observations) -> float:
    """Return the cost of a start after one step of the poses."""
    values = {name: start.values.get(name, mean) for name, mean in model.means.items()}
    poses = model.pad_poses(joint.poses)
    parameters = replace(model.parameters, origin=values)
    problem = landing_problem(model.path, parameters, observations, poses, joint.sigma)
    return problem.inner_step(poses.new_zeros(parameters.count), poses)[1]


def start_with_effect(model: CameraModel, observations: Observations, joint: Estimate) -> Estimate:
    """Return a fit of the model without its last effect, moved to the start of a fit with it.

    It is unchanged if the effect starts at its neutral value, or was already fitted.
    """
    effect = model.effects[-1]
    if all(u.start is None or u.param.name in joint.values for u in effect.effect_parameters):
        return joint
    free = {param.name for param in model.parameters.free}
    values = {name: joint.values.get(name, mean) for name, mean in model.means.items()}
    candidates = [shift for shift in effect.alternative_starts(values) if shift.keys() <= free]
    if candidates:
        chosen = torch.zeros(len(joint.poses), dtype=torch.bool)
        chosen[torch.linspace(0, len(chosen) - 1, START_VIEWS).round().long()] = True
        views = observations.without_views(~chosen)
        poses = joint.poses[chosen]

        values |= min(
            candidates,
            key=lambda shift: _fit_poses(model, views, poses, joint.sigma, {**values, **shift})[0],
        )
    _, poses = _fit_poses(model, observations, joint.poses, joint.sigma, values)
    return replace(joint, values=values, poses=poses)


def rough_fit(model: CameraModel, observations: Observations, joint: Estimate) -> JointFit:
    """Fit the model roughly, from a fit without its last effect."""
    start = start_with_effect(model, observations, joint)
    return model.fit(observations, start.poses, start.start, ROUGH_ROUNDS)


def _fit_poses(
    model: CameraModel, observations: Observations, initial: Tensor, sigma: float, values: Values
) -> tuple[float, Tensor]:
    """Return the median error in px and the (V, B) poses, from (V, B') initial poses."""
    poses = model.pad_poses(initial)
    rough = rough_poses(model.path, values, observations)
    poses[:, :6] = torch.where(torch.isfinite(rough), rough, poses[:, :6])
    poses = refine_poses_in_image(
        model.path, values, observations, poses, sigma=sigma, tolerance=POSE_TOLERANCE
    ).blocks
    image = residuals(model.path, values, observations, poses).image
    return float(image.norm(dim=-1).nanmedian()), poses
