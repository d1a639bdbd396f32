"""Where a fit begins with an effect that does much from the start, such as water behind a window.

What was fitted without it has made up for it: boards stand a third nearer than they are, or the
focal length is a third longer, and some views lie on the wrong side of the two that a planar target
has. From there a joint fit ends in another valley. So poses are begun anew through the path as it
will be.
"""

from dataclasses import replace

import torch
from torch import Tensor

from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUGH_ROUNDS, JointFit
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


def begun(model: CameraModel, observations: Observations, joint: JointFit) -> JointFit:
    """A fit of the model without its last effect, brought to where one with it is to begin; as it
    is, where the effect begins with doing nothing, or is there already.
    """
    effect = model.effects[-1]
    if all(u.start is None or u.param.name in joint.values for u in effect.effect_parameters):
        return joint
    fitted = {param.name for param in model.parameters.free}
    here = {name: joint.values.get(name, mean) for name, mean in model.means.items()}
    others = [there for there in effect.alternative_starts(here) if there.keys() <= fitted]
    if others:
        few = torch.zeros(len(joint.poses), dtype=torch.bool)
        few[torch.linspace(0, len(few) - 1, FEW).round().long()] = True
        some, poses = observations.without_views(~few), joint.poses[few]
        here |= min(
            others, key=lambda there: _posed(model, some, poses, joint.sigma, {**here, **there})[0]
        )
    return replace(
        joint, values=here, poses=_posed(model, observations, joint.poses, joint.sigma, here)[1]
    )


def rough_fit(model: CameraModel, observations: Observations, joint: JointFit) -> JointFit:
    """Of the model, from a fit without its last effect."""
    start = begun(model, observations, joint)
    return model.fit(observations, start.poses, start.start, ROUGH_ROUNDS)


def _posed(
    model: CameraModel, observations: Observations, before: Tensor, sigma: float, values: Values
) -> tuple[float, Tensor]:
    """The median px that is left, and the (V, B) poses, which were (V, B') before."""
    poses = model.pad_poses(before)
    found = rough_poses(model.path, values, observations)
    poses[:, :6] = torch.where(torch.isfinite(found), found, poses[:, :6])
    poses = refine_poses_in_image(
        model.path, values, observations, poses, sigma=sigma, tolerance=NEAR
    ).blocks
    missed = residuals(model.path, values, observations, poses)
    return float(missed.image.norm(dim=-1).nanmedian()), poses
