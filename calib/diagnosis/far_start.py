"""Where a fit begins with an effect that does much from the start, such as water behind a window.

What was fitted without it has made up for it: boards stand a third nearer than they are, or the focal length is a third longer, and some
views lie on the wrong side of the two that a planar target has. From there a joint fit ends in another valley. So poses are begun anew
through the path as it will be.
"""

from dataclasses import replace

import torch

from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.estimation.poses import refit_poses, rough_poses
from calib.optics.params import Values


def begun(model: CameraModel, observations: Observations, joint: JointFit) -> JointFit:
    """A fit of the model without its last effect, brought to where one with it is to begin; as it is, where the effect begins with doing
    nothing, or is there already."""
    effect = model.effects[-1]
    if all(u.start is None or u.param.name in joint.values for u in effect.unknowns):
        return joint
    fitted = {param.name for param in model.parameters.free}
    here = {name: joint.values.get(name, mean) for name, mean in model.means.items()}
    others = [there for there in effect.displaced(here) if there.keys() <= fitted]
    starts = [_posed(model, observations, joint, {**here, **there}) for there in others or [{}]]
    return min(starts, key=lambda start: start[0])[1]


def _posed(model: CameraModel, observations: Observations, joint: JointFit, values: Values) -> tuple[float, JointFit]:
    """The median px that is left, and the start."""
    poses = model.padded(joint.poses)
    found = rough_poses(model.path, values, observations)
    poses[:, :6] = torch.where(torch.isfinite(found), found, poses[:, :6])
    poses, missed = refit_poses(model.path, values, observations, poses, sigma=joint.sigma)
    return float(missed.image.norm(dim=-1).nanmedian()), replace(joint, values=dict(values), poses=poses)
