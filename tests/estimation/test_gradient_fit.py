"""The paper's procedure on noise-free scenes of known truth."""

from itertools import pairwise

import pytest
import torch

from calib.estimation.gradient_fit import descend
from calib.estimation.poses import pinhole_poses, refine_poses
from calib.estimation.residuals import residuals
from calib.optics.build import covered_path
from calib.optics.exposure import MIDDLE
from fixtures.synthetic import INTRINSICS, paper_cone, scene


@pytest.mark.parametrize("amplitude", [1e-6, 1e-5, 1e-4])
def test_amplitudes_fall_to_almost_nothing_of_the_cone_s_error(amplitude: float) -> None:
    """The bar of Fig. 4a: true poses, 500 steps, RMSE under 2 % of the regular cone's, at every
    amplitude with the same settings.
    """
    made = scene(1, views=10, amplitude=amplitude)
    smooth, smooth_values = covered_path(INTRINSICS, paper_cone())
    cone = residuals(smooth, smooth_values, made.observations, made.poses)
    values = {**made.values, "relief.amplitudes": torch.zeros(4, 4, dtype=torch.float64)}
    values["relief.amplitudes"] = descend(
        made.path, values, made.observations, made.poses, steps=500
    )
    fitted = residuals(made.path, values, made.observations, made.poses)
    assert fitted.rmse_cm < 0.02 * cone.rmse_cm


def test_the_loss_falls_and_more_steps_do_not_harm() -> None:
    made = scene(2, views=5)
    values = {**made.values, "relief.amplitudes": torch.zeros(4, 4, dtype=torch.float64)}
    losses: list[float] = []
    descend(
        made.path,
        values,
        made.observations,
        made.poses,
        steps=60,
        progress=lambda _, loss: losses.append(loss),
    )
    assert len(losses) == 60
    assert all(later <= earlier for earlier, later in pairwise(losses))
    assert losses[-1] < 0.1 * losses[0]


def test_poses_are_recovered_through_the_true_cover() -> None:
    made = scene(3, views=8, amplitude=2e-5)
    start = pinhole_poses(made.path, made.values, made.observations)
    refined = refine_poses(made.path, made.values, made.observations, start).blocks
    assert (start - made.poses).abs().max() > 1e-4, (
        "the pinhole's poses are wrong, so there is something to refine"
    )
    assert (refined - made.poses).abs().max() < 1e-8


def test_residuals_of_the_true_model_are_zero() -> None:
    made = scene(4, views=3)
    at_truth = residuals(made.path, made.values, made.observations, made.poses)
    assert at_truth.rms_px < 1e-8
    assert at_truth.rmse_cm < 1e-10


def test_image_and_board_residuals_agree_to_first_order() -> None:
    """DESIGN: e_px = -(d x_cb / d p)^-1 (x_cb - x_true), here by a difference of two
    projections.
    """
    made = scene(5, views=3, noise=0.05)
    residual = residuals(made.path, made.values, made.observations, made.poses)
    size = 1e-4
    pixels = made.observations.pixels
    poses = made.poses[made.observations.view]
    landed = made.path.land(pixels, made.values, poses, MIDDLE)[0]
    jacobian = torch.stack(
        [
            (made.path.land(pixels + size * axis, made.values, poses, MIDDLE)[0] - landed) / size
            for axis in torch.eye(2, dtype=torch.float64)
        ],
        -1,
    )
    expected = -torch.linalg.solve(jacobian, residual.board.unsqueeze(-1)).squeeze(-1)
    assert (residual.image - expected).abs().max() < 1e-3 * residual.image.abs().max()
