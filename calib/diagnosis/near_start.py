"""Where a fit begins without an effect that an earlier one had: what stays takes up what it can of
it.

By how much, the earlier fit's covariance says to first order: the mean of what stays, given that
what goes is not there. From where the earlier fit ended, a lens whose other coefficients have to
make up for one that goes was often not found.
"""

from dataclasses import replace

import torch

from calib.estimation.camera_model import CameraModel
from calib.estimation.elimination import landing_problem
from calib.estimation.joint_fit import JointFit, Start, invert_precision
from calib.estimation.observations import Observations
from calib.optics.params import Values


def start_of_fewer(
    model: CameraModel, before: CameraModel, joint: JointFit, observations: Observations
) -> Start:
    """Of the two starts, with and without what the covariance says, the one from which less is left
    once boards have adapted.

    Args:
        model: with fewer effects than `before`, or simpler ones.
        joint: the fit of `before`.
    """
    stay = {param.name for param in model.parameters.free}
    neutral = [before.neutral_values(effect) for effect in before.effects]
    gone = {name: value for values in neutral for name, value in values.items() if name not in stay}
    if not gone:
        return joint.start
    starts = [
        Start({**joint.values, **values}, joint.sigma, joint.smoothness)
        for values in ({}, _given(joint, gone))
    ]
    return min(starts, key=lambda start: _left(model, start, joint, observations))


def _given(joint: JointFit, nothing: Values) -> Values:
    """The parameters that stay, where those that go have these values."""
    parameters = joint.parameters
    goes = torch.from_numpy(
        parameters.entries(name for name in nothing if name in parameters.slices())
    )
    if not len(goes):
        return {}
    here, there = parameters.vector(joint.values), parameters.vector({**joint.values, **nothing})
    known = invert_precision(joint.covariance[goes][:, goes]) @ (there - here)[goes]
    moved = parameters.values(here + joint.covariance[:, goes] @ known)
    return moved | {
        param.name: moved[param.name].clamp_min(param.minimum) for param in parameters.free
    }


def _left(model: CameraModel, start: Start, joint: JointFit, observations: Observations) -> float:
    values = {name: start.values.get(name, mean) for name, mean in model.means.items()}
    poses = model.pad_poses(joint.poses)
    parameters = replace(model.parameters, origin=values)
    problem = landing_problem(model.path, parameters, observations, poses, joint.sigma)
    return problem.inner_step(poses.new_zeros(parameters.count), poses)[1]
