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
from calib.estimation.elimination import problem_at
from calib.estimation.joint_fit import ROUGH, JointFit, Start, inverse
from calib.estimation.observations import Observations
from calib.estimation.poses import refine_poses_in_image, rough_poses
from calib.estimation.residuals import residuals
from calib.optics.params import Values

NEAR = 0.03
"""The fraction of its squares by which the last step of a start's poses may still lower them: the
fit goes on from there.
"""
FEW = 8
"""Views that choose among starts."""


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
    neutral = [before.neutral(effect) for effect in before.effects]
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
    known = inverse(joint.covariance[goes][:, goes]) @ (there - here)[goes]
    moved = parameters.values(here + joint.covariance[:, goes] @ known)
    return moved | {
        param.name: moved[param.name].clamp_min(param.least) for param in parameters.free
    }


def _left(model: CameraModel, start: Start, joint: JointFit, observations: Observations) -> float:
    values = {name: start.values.get(name, mean) for name, mean in model.means.items()}
    poses = model.padded(joint.poses)
    parameters = replace(model.parameters, origin=values)
    problem = problem_at(model.path, parameters, observations, poses, joint.sigma)
    return problem.settled(poses.new_zeros(parameters.count), poses)[1]


def begun(model: CameraModel, observations: Observations, joint: JointFit) -> JointFit:
    """A fit of the model without its last effect, brought to where one with it is to begin; as it
    is, where the effect begins with doing nothing, or is there already.
    """
    effect = model.effects[-1]
    if all(u.start is None or u.param.name in joint.values for u in effect.unknowns):
        return joint
    fitted = {param.name for param in model.parameters.free}
    here = {name: joint.values.get(name, mean) for name, mean in model.means.items()}
    others = [there for there in effect.displaced(here) if there.keys() <= fitted]
    if others:
        few = torch.zeros(len(joint.poses), dtype=torch.bool)
        few[torch.linspace(0, len(few) - 1, FEW).round().long()] = True
        some, poses = observations.without(~few), joint.poses[few]
        here |= min(
            others, key=lambda there: _posed(model, some, poses, joint.sigma, {**here, **there})[0]
        )
    return replace(
        joint, values=here, poses=_posed(model, observations, joint.poses, joint.sigma, here)[1]
    )


def rough_fit(model: CameraModel, observations: Observations, joint: JointFit) -> JointFit:
    """Of the model, from a fit without its last effect."""
    start = begun(model, observations, joint)
    return model.fitted(observations, start.poses, start.start, ROUGH)


def _posed(
    model: CameraModel, observations: Observations, before: Tensor, sigma: float, values: Values
) -> tuple[float, Tensor]:
    """The median px that is left, and the (V, B) poses, which were (V, B') before."""
    poses = model.padded(before)
    found = rough_poses(model.path, values, observations)
    poses[:, :6] = torch.where(torch.isfinite(found), found, poses[:, :6])
    poses = refine_poses_in_image(
        model.path, values, observations, poses, sigma=sigma, tolerance=NEAR
    ).blocks
    missed = residuals(model.path, values, observations, poses)
    return float(missed.image.norm(dim=-1).nanmedian()), poses
