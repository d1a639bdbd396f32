"""The evidence that the glass is uneven: the texture of a relief against even glass, at the optimum
of a fit without a relief.

Uneven glass has a figure as well, but the views can hardly tell a figure from the cover's numbers.
So the texture alone decides, and no further fit is needed: the corners' probability is that of the
linearised model.
"""

from dataclasses import replace

import torch

from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import UNEVEN_GLASS, JointFit, marginal_likelihood
from calib.estimation.normal_equations import normal_equations
from calib.estimation.objective import LandingProblem, huber_limit, view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.estimation.residuals import reach_board
from calib.estimation.surface_prior import MIN_HEIGHT, Smoothness, maximise_evidence
from calib.optics.build import with_relief
from calib.optics.relief import AMPLITUDES, Relief


def uneven_log_odds(
    model: CameraModel, joint: JointFit, observations: Observations, relief: Relief
) -> tuple[float, Smoothness]:
    """Return the log Bayes factor of a texture against even glass, and the most probable texture.

    Args:
        model: a model without a relief.
        observations: the views of its fit.
        joint: its fit.
        relief: the relief that the glass may have.
    """
    path = with_relief(model.path, relief)
    flat = {AMPLITUDES: torch.zeros(relief.grid, dtype=torch.float64)}
    values = {**joint.values, **flat}
    observations = observations.select_rows(reach_board(path, values, observations, joint.poses))
    parameters = Parameters.of(path, {**model.means, **flat}, model.priors)
    shared = parameters.vector(values)
    weights = pixel_weights(path, values, observations, joint.poses, joint.sigma)
    problem = LandingProblem(
        parameters,
        tuple(make_residual_blocks(path, parameters, observations, weights, values)),
        shared.new_zeros(len(shared), len(shared)),
        view_precision(path, joint.poses),
        huber_limit(observations),
    )
    equations = normal_equations(problem.linearise(shared, joint.poses))
    freedom = observations.residual_count - joint.poses.numel()
    likelihood, apparent = marginal_likelihood(
        equations, shared, freedom, joint.sigma, parameters, observations.merged_squares
    )
    start = replace(UNEVEN_GLASS, figure=0.0)
    sigma, texture = maximise_evidence(likelihood, apparent, start)
    even = Smoothness(MIN_HEIGHT, start.length, figure=0.0)
    assert texture
    log_odds = likelihood.log(sigma, texture) - likelihood.log(joint.sigma, even)
    return log_odds, replace(texture, figure=1.0)
