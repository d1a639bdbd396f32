"""The Savage-Dickey ratio: the evidence of a model with fewer parameters, from the fit of a larger
one. It is the density of the removed parameters' neutral values after the fit over their density in
the prior.

Source: J. M. Dickey, The weighted likelihood ratio, linear hypotheses on normal location parameters
    (1971).
"""

import numpy as np

from calib.estimation.camera_model import CameraModel
from calib.estimation.covariance import invert_precision
from calib.estimation.joint_fit import JointFit


def savage_dickey_log_odds(form: CameraModel, largest: CameraModel, joint: JointFit) -> float:
    """Return the log evidence of a form minus that of the largest form, whose fit is `joint`."""
    names = {param.name for param in form.parameters.free}
    parameters = joint.parameters
    removed = [param for param in parameters.free if param.name not in names]
    if not removed:
        return 0.0
    entries = parameters.entries(param.name for param in removed)
    neutral = parameters.vector(largest.means)[entries]
    distance = parameters.vector(joint.values)[entries] - neutral
    covariance = joint.covariance[entries][:, entries]
    sigmas = [np.ravel(largest.priors.sigmas[param.name]) / param.scale for param in removed]
    square = distance @ invert_precision(covariance) @ distance
    log_posterior = -float(square + covariance.slogdet().logabsdet) / 2
    return float(log_posterior + np.log(np.concatenate(sigmas)).sum())
