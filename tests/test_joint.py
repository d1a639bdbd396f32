"""The joint fit on scenes of known truth, and its prior against a brute-force oracle."""

import numpy as np
import pytest
import torch
from scipy.stats import multivariate_normal

from calib.evaluate import refit_poses
from calib.joint import JointFit, JointProblem, fit_joint
from calib.observations import Observations
from calib.optics.build import covered_path, footprint, with_relief
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.paper import descend
from calib.poses import pinhole_poses, refine_poses
from calib.prior import Rows, Smoothness, log_evidence
from calib.residuals import residuals
from calib.solve import Outcome
from calib.views import View
from tests.scenes import HEIGHT, INTRINSICS, PATCH, WIDTH, Scene, paper_cone, scene

NOISE = 0.1
FLOOR = NOISE * 2**0.5
"""px: the two-dimensional error that noise alone leaves on held-out views, but for six numbers a view."""


THIN = paper_cone(thickness=0.00115)
"""The glass that reproduces the paper's Fig. 8."""


def start(made: Scene, grid: tuple[int, int] = (8, 8)) -> tuple[Path, dict[str, torch.Tensor], torch.Tensor]:
    """A smooth cover's poses, and a flat relief."""
    smooth, values = covered_path(INTRINSICS, THIN)
    poses = refine_poses(smooth, values, made.observations, pinhole_poses(made.observations, values)).blocks
    path = with_relief(smooth, Relief(*footprint(smooth, values, WIDTH, HEIGHT), grid))
    return path, {**values, "relief.amplitudes": torch.zeros(grid, dtype=torch.float64)}, poses


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(1, views=45, noise=NOISE, cover=THIN)


def others(depths: tuple[float, float]) -> Scene:
    """Ten more views through the same glass."""
    return scene(1, views=10, noise=NOISE, cover=THIN, depths=depths)


@pytest.fixture(scope="module")
def fitted(made: Scene) -> tuple[Path, JointFit]:
    path, values, poses = start(made)
    return path, fit_joint(path, values, made.observations, poses)


def held_out(path: Path, values: dict[str, torch.Tensor], other: Scene) -> float:
    return refit_poses(path, values, other.observations, other.poses)[1].rms_px


def test_derivatives_agree_with_central_differences() -> None:
    """At the truth of a noise-free scene, where the neglected change of the pixel weighting has nothing to act on."""
    made = scene(1, views=3, grid=(4, 5), amplitude=2e-5)
    free = ("cover.thickness", "cover.refractive_index", "cover.axis_offset.z", "camera.fx", "camera.cy")
    count = 20 + len(free)
    problem = JointProblem(made.path, made.values, made.observations, free, 1.0, torch.zeros(count, count, dtype=torch.float64))
    shared = torch.zeros(count, dtype=torch.float64)
    at = problem.linearise(shared, made.poses)
    assert at.residual.abs().max() < 1e-8

    def rows(amount: torch.Tensor, poses: torch.Tensor) -> torch.Tensor:
        return problem.linearise(amount, poses).residual

    for column in range(count):
        step = torch.zeros(count, dtype=torch.float64)
        step[column] = 1e-8 if column < 20 else 1e-4
        numeric = (rows(shared + step, made.poses) - rows(shared - step, made.poses)) / (2 * step[column])
        assert (at.by_shared[..., column] - numeric).abs().max() < 1e-5 * numeric.abs().max(), column
    for column in range(6):
        step = torch.zeros_like(made.poses)
        step[:, column] = 1e-7
        numeric = (rows(shared, made.poses + step) - rows(shared, made.poses - step)) / 2e-7
        assert (at.by_block[..., column] - numeric).abs().max() < 1e-5 * numeric.abs().max(), column


def test_converges_in_few_steps_to_the_noise_floor(made: Scene, fitted: tuple[Path, JointFit]) -> None:
    path, joint = fitted
    assert joint.outcome is Outcome.CONVERGED
    assert joint.iterations < 40
    assert joint.sigma == pytest.approx(NOISE, rel=0.05)  # 3,645 corners: 0.8 % standard error
    assert residuals(path, joint.values, made.observations, joint.poses).rms_px < 1.02 * FLOOR


def test_held_out_views_are_at_the_floor(fitted: tuple[Path, JointFit]) -> None:
    path, joint = fitted
    other = others((0.7, 1.1))
    truth = held_out(other.path, other.values, other)
    assert held_out(path, joint.values, other) < 1.05 * truth


def test_nearer_than_any_training_view_it_stays_within_30_percent_of_the_floor(fitted: tuple[Path, JointFit]) -> None:
    path, joint = fitted
    near = others((0.17, 0.3))
    assert held_out(path, joint.values, near) < 1.3 * held_out(near.path, near.values, near)


def test_beats_the_paper_s_procedure_on_the_same_corners(made: Scene, fitted: tuple[Path, JointFit]) -> None:
    path, values, poses = start(made)
    values["relief.amplitudes"] = descend(path, values, made.observations, poses, steps=200)
    near = others((0.17, 0.3))
    assert held_out(path, values, near) > 1.5 * held_out(path, fitted[1].values, near)


def test_is_deterministic(made: Scene, fitted: tuple[Path, JointFit]) -> None:
    path, values, poses = start(made)
    again = fit_joint(path, values, made.observations, poses)
    assert torch.equal(again.values["relief.amplitudes"], fitted[1].values["relief.amplitudes"])


def test_single_bad_corners_do_not_pull(made: Scene) -> None:
    """Three corners in a hundred are 3 px off: held-out error grows by a tenth at most."""
    rng = np.random.default_rng(0)
    spoiled = []
    for view in made.views:
        corners = view.corners.copy()
        bad = rng.random(81) < 0.03
        corners[bad] += rng.normal(0, 3, (int(bad.sum()), 2))
        spoiled.append(View(view.name, corners, view.weight))
    path, values, poses = start(made)
    joint = fit_joint(path, values, Observations.of(spoiled, made.board), poses)
    other = others((0.7, 1.1))
    assert held_out(path, joint.values, other) < 1.1 * held_out(other.path, other.values, other)


def test_a_freed_focal_length_mends_what_a_wrong_one_spoils(made: Scene) -> None:
    """The number itself is hardly told apart from a lens-shaped relief, so it is the held-out error that counts."""
    path, values, poses = start(made)
    wrong = {**values, "camera.fx": values["camera.fx"] * 1.01, "camera.fy": values["camera.fy"] * 0.99}
    held = fit_joint(path, wrong, made.observations, poses)
    freed = fit_joint(path, wrong, made.observations, poses, free={"camera.fx": 30.0, "camera.fy": 30.0})
    near = others((0.17, 0.3))
    assert set(freed.estimates()) == {"camera.fx", "camera.fy"}
    assert all(0 < number.sigma < 30 for number in freed.estimates().values()), "the corners say more than the prior"
    assert held_out(path, freed.values, near) < 0.8 * held_out(path, held.values, near)


def test_evidence_is_the_marginal_likelihood() -> None:
    """Brute force: with amplitudes integrated out, the residuals are normal with covariance sigma^2 I + J P^-1 J^T."""
    relief = Relief(*PATCH, (3, 4))
    rng = np.random.default_rng(0)
    jacobian = rng.normal(size=(40, 12)) * 1e5
    residual = rng.normal(size=40)
    here = torch.from_numpy(rng.normal(size=12) * 1e-6)
    rows = Rows(torch.from_numpy(jacobian.T @ jacobian), torch.from_numpy(jacobian.T @ residual), float(residual @ residual), 40)
    at_zero = residual - jacobian @ here.numpy()  # linear: the residuals of the flat relief
    ours, theirs = [], []
    for sigma, smoothness in ((0.5, Smoothness(1e-5, 0.4)), (1.3, Smoothness(3e-6, 0.2)), (1.0, Smoothness(4e-5, 1.0))):
        ours.append(log_evidence(rows, here, relief, sigma, smoothness, torch.zeros(0, dtype=torch.float64)))
        spread = np.linalg.inv(smoothness.precision(relief).numpy())
        covariance = sigma**2 * np.eye(40) + jacobian @ spread @ jacobian.T
        theirs.append(multivariate_normal(np.zeros(40), covariance).logpdf(at_zero))
    assert np.diff(ours) == pytest.approx(np.diff(theirs), rel=1e-5)


def test_the_prior_s_heights_have_the_stated_spread() -> None:
    relief = Relief(*PATCH, (6, 5))
    smoothness = Smoothness(2e-5, 0.5)
    rows, columns = (torch.linspace(low, high, n, dtype=torch.float64) for low, high, n in zip(*PATCH, (6, 5), strict=True))
    at = torch.cartesian_prod(rows, columns)
    basis = relief.columns((at[:, 0], at[:, 1]))[0]
    spread = basis @ torch.linalg.inv(smoothness.precision(relief)) @ basis.mT
    assert spread.diagonal().sqrt().tolist() == pytest.approx([2e-5] * 30, rel=1e-4)
    assert float(spread[0, 1] / spread[0, 0]) == pytest.approx(np.exp(-((1 / 4) ** 2) / (2 * 0.25)), rel=1e-4)
