"""The joint fit on scenes of known truth, and its prior against a brute-force oracle."""

import numpy as np
import pytest
import torch
from scipy.linalg import block_diag
from scipy.special import eval_legendre
from scipy.stats import multivariate_normal

from calib.corners.view import View
from calib.estimation.gradient_fit import descend
from calib.estimation.joint_fit import JointFit, fit_joint
from calib.estimation.levenberg_marquardt import Outcome, minimise
from calib.estimation.objective import LandingProblem, view_precision
from calib.estimation.observations import Observations
from calib.estimation.parameters import Parameters
from calib.estimation.poses import pinhole_poses, refine_poses, refit_poses
from calib.estimation.priors import Priors
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.estimation.residuals import residuals
from calib.estimation.surface_prior import MarginalLikelihood, Quadratic, Smoothness
from calib.optics.build import covered_path, footprint, with_relief
from calib.optics.exposure import MIDDLE
from calib.optics.path import Path
from calib.optics.relief import Relief
from fixtures.synthetic import HEIGHT, INTRINSICS, PATCH, WIDTH, Scene, paper_cone, scene

NOISE = 0.1
FLOOR = NOISE * 2**0.5
"""px: the two-dimensional error that noise alone leaves on held-out views, but for six numbers a
view.
"""


THIN = paper_cone(thickness=0.00115)
"""The glass that reproduces the paper's Fig. 8."""


def start(
    made: Scene, grid: tuple[int, int] = (8, 8)
) -> tuple[Path, dict[str, torch.Tensor], torch.Tensor]:
    """A smooth cover's poses, and a flat relief."""
    smooth, values = covered_path(INTRINSICS, THIN)
    poses = refine_poses(
        smooth, values, made.observations, pinhole_poses(smooth, values, made.observations)
    ).blocks
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


def held_out(path: Path, values: dict[str, torch.Tensor], held_out_scene: Scene) -> float:
    return refit_poses(path, values, held_out_scene.observations, held_out_scene.poses)[1].rms_px


def test_derivatives_agree_with_central_differences() -> None:
    made = scene(1, views=3, grid=(4, 5), amplitude=2e-5, noise=0.1)
    names = (
        "cover.thickness",
        "cover.refractive_index",
        "cover.axis_offset.z",
        "camera.fx",
        "camera.cy",
    )
    parameters = Parameters.of(made.path, made.values, Priors(dict.fromkeys(names, 1.0)))
    weights = pixel_weights(made.path, made.values, made.observations, made.poses, 1.0)
    views = tuple(make_residual_blocks(made.path, parameters, made.observations, weights))
    nothing = torch.zeros(parameters.count, parameters.count, dtype=torch.float64)
    problem = LandingProblem(
        parameters, views, nothing, view_precision(made.path, made.poses), huber=torch.inf
    )
    origin = torch.zeros(parameters.count, dtype=torch.float64)

    def rows(amount: torch.Tensor, poses: torch.Tensor) -> torch.Tensor:
        return torch.cat([at.residual for at in problem.linearise(amount, poses)])

    (at,) = problem.linearise(origin, made.poses)
    assert problem.cost(origin, made.poses) == pytest.approx(
        float((at.residual**2).sum()), rel=1e-12
    )
    for column in range(parameters.count):
        step = torch.zeros(parameters.count, dtype=torch.float64)
        step[column] = 1e-8 if column < parameters.amplitudes else 1e-4
        numeric = (rows(origin + step, made.poses) - rows(origin - step, made.poses)) / (
            2 * step[column]
        )
        assert (
            at.jacobian_shared[..., column] - numeric
        ).abs().max() < 1e-6 * numeric.abs().max(), column
    for column in range(6):
        step = torch.zeros_like(made.poses)
        step[:, column] = 1e-7
        numeric = (rows(origin, made.poses + step) - rows(origin, made.poses - step)) / 2e-7
        assert (
            at.jacobian_block[..., column] - numeric
        ).abs().max() < 1e-6 * numeric.abs().max(), column


@pytest.mark.parametrize("huber", [torch.inf, 3.0])
def test_views_settle_where_a_fit_of_each_by_itself_ends(huber: float) -> None:
    """The shared parameters moved, by sixty pixels of focal length, and the poses not: rows and
    priors as `cost` has them, one view after the other. A step that would raise a view's cost is
    not taken.
    """
    made = scene(1, views=3, grid=(4, 5), amplitude=2e-5, noise=0.1)
    parameters = Parameters.of(
        made.path, made.values, Priors({"camera.fx": 1.0, "cover.thickness": 1.0})
    )
    weights = pixel_weights(made.path, made.values, made.observations, made.poses, 1.0)
    views = tuple(make_residual_blocks(made.path, parameters, made.observations, weights))
    nothing = torch.zeros(parameters.count, parameters.count, dtype=torch.float64)
    far_pose = torch.tensor([0.0, 0.0, 0.0, 0.0, 0.0, 4.0], dtype=torch.float64)
    problem = LandingProblem(parameters, views, nothing, far_pose, huber)
    moved = torch.zeros(parameters.count, dtype=torch.float64)
    moved[parameters.entries(["camera.fx"])] = 60.0

    def whole(poses: torch.Tensor) -> float:
        return problem.cost(moved, poses) + float((poses**2 @ far_pose).sum())

    poses, costs = made.poses, []
    for _ in range(4):
        settled, cost = problem.inner_step(moved, poses)
        assert cost == pytest.approx(problem.cost(moved, settled), rel=1e-12)
        assert whole(settled) <= whole(poses)
        poses = settled
        costs.append(whole(poses))
    rows = Parameters.none(parameters.values(moved))
    alone = LandingProblem(
        rows,
        tuple(make_residual_blocks(made.path, rows, made.observations, weights)),
        torch.zeros(0, 0).double(),
        far_pose,
        huber,
    )
    minimum = minimise(alone, torch.zeros(0).double(), made.poses, tolerance=1e-14).cost
    assert costs[0] - minimum < 0.02 * (whole(made.poses) - minimum), "one step is nearly all"
    assert costs[-1] == pytest.approx(minimum, rel=1e-6)
    rng = torch.Generator().manual_seed(0)
    for _ in range(20):  # from far away a step may lead anywhere
        far = poses + 0.5 * torch.randn(3, 6, generator=rng).double()
        assert whole(problem.inner_step(moved, far)[0]) <= whole(far)


@pytest.mark.parametrize("huber", [torch.inf, 1e-3])
def test_bends_agree_with_central_differences(huber: float) -> None:
    """The residuals' second derivative along a move of everything, weighted as the rows are.

    So short a move has no third derivative.
    """
    made = scene(1, views=3, grid=(4, 5), amplitude=2e-5, noise=0.1)
    parameters = Parameters.of(
        made.path, made.values, Priors({"camera.fx": 1.0, "cover.thickness": 1.0})
    )
    weights = pixel_weights(made.path, made.values, made.observations, made.poses, 1.0)
    views = tuple(make_residual_blocks(made.path, parameters, made.observations, weights))
    nothing = torch.zeros(parameters.count, parameters.count, dtype=torch.float64)
    problem = LandingProblem(
        parameters, views, nothing, view_precision(made.path, made.poses), huber=huber
    )
    smooth = LandingProblem(
        parameters, views, nothing, view_precision(made.path, made.poses), huber=torch.inf
    )
    rng = torch.Generator().manual_seed(0)
    scale = torch.where(torch.arange(parameters.count) < parameters.amplitudes, 1e-6, 1e-2)
    move = (
        scale * torch.randn(parameters.count, generator=rng, dtype=torch.float64),
        1e-3 * torch.randn(3, 6, generator=rng).double(),
    )
    origin = torch.zeros(parameters.count, dtype=torch.float64)

    def rows(side: float) -> torch.Tensor:
        return torch.cat(
            [
                at.residual
                for at in smooth.linearise(origin + side * move[0], made.poses + side * move[1])
            ]
        )

    pieces = list(problem.linearise(origin, made.poses))
    bend = torch.cat(list(problem.second_derivative_along(pieces, origin, made.poses, move)))
    weight = torch.cat([at.residual for at in pieces]).norm(dim=-1) / rows(0.0).norm(dim=-1)
    near = 0.05
    numeric = weight[:, None] * (rows(near) - 2 * rows(0.0) + rows(-near)) / near**2
    assert (
        bend - numeric
    ).abs().max() < 0.02 * numeric.abs().max()  # a tenth of the move ahead and none behind


def test_a_run_of_views_at_a_time_gives_the_same_fit(
    made: Scene, fitted: tuple[Path, JointFit], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("calib.estimation.residual_blocks.BATCH_SIZE", 700)
    path, values, poses = start(made)
    joint = fit_joint(path, values, made.observations, poses)
    assert (joint.poses - fitted[1].poses).abs().max() < 1e-9


def test_pixel_weights_make_the_reprojection_error_to_first_order() -> None:
    """Against the forward projection: of errors of 0.1 px the second order leaves about a
    thousandth.
    """
    made = scene(2, views=3, noise=0.1)
    weights = pixel_weights(made.path, made.values, made.observations, made.poses, 0.5)
    landed, _ = made.path.land(
        made.observations.pixels, made.values, made.poses[made.observations.view], MIDDLE
    )
    whitened = (weights @ (landed - made.observations.corners).unsqueeze(-1)).squeeze(-1)
    exact = residuals(made.path, made.values, made.observations, made.poses).image / 0.5
    assert (whitened - exact).abs().max() < 2e-3 * exact.abs().max()


def test_converges_in_few_steps_to_the_noise_floor(
    made: Scene, fitted: tuple[Path, JointFit]
) -> None:
    path, joint = fitted
    assert joint.outcome is Outcome.CONVERGED
    assert joint.iterations < 40
    assert joint.sigma == pytest.approx(NOISE, rel=0.05)  # 3,645 corners: 0.8 % standard error
    assert residuals(path, joint.values, made.observations, joint.poses).rms_px < 1.02 * FLOOR


def test_held_out_views_are_at_the_floor(fitted: tuple[Path, JointFit]) -> None:
    path, joint = fitted
    held_out_scene = others((0.7, 1.1))
    truth = held_out(held_out_scene.path, held_out_scene.values, held_out_scene)
    assert held_out(path, joint.values, held_out_scene) < 1.05 * truth


def test_nearer_than_any_training_view_it_stays_within_30_percent_of_the_floor(
    fitted: tuple[Path, JointFit],
) -> None:
    path, joint = fitted
    near = others((0.17, 0.3))
    assert held_out(path, joint.values, near) < 1.3 * held_out(near.path, near.values, near)


@pytest.mark.slow
def test_beats_the_paper_s_procedure_on_the_same_corners(
    made: Scene, fitted: tuple[Path, JointFit]
) -> None:
    path, values, poses = start(made)
    values["relief.amplitudes"] = descend(path, values, made.observations, poses, steps=200)
    near = others((0.17, 0.3))
    assert held_out(path, values, near) > 1.5 * held_out(path, fitted[1].values, near)


def test_is_deterministic(made: Scene, fitted: tuple[Path, JointFit]) -> None:
    path, values, poses = start(made)
    second_fit = fit_joint(path, values, made.observations, poses)
    assert torch.equal(
        second_fit.values["relief.amplitudes"], fitted[1].values["relief.amplitudes"]
    )


@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device here")
def test_a_gpu_gives_the_same(made: Scene, fitted: tuple[Path, JointFit]) -> None:
    path, values, poses = start(made)
    gpu_values = {name: value.cuda() for name, value in values.items()}
    joint = fit_joint(path, gpu_values, made.observations.to("cuda"), poses.cuda())
    amplitudes = fitted[1].values["relief.amplitudes"]
    assert (
        joint.values["relief.amplitudes"].cpu() - amplitudes
    ).abs().max() < 1e-6 * amplitudes.abs().max()
    assert (joint.poses.cpu() - fitted[1].poses).abs().max() < 1e-6


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
    held_out_scene = others((0.7, 1.1))
    assert held_out(path, joint.values, held_out_scene) < 1.1 * held_out(
        held_out_scene.path, held_out_scene.values, held_out_scene
    )


def test_a_freed_focal_length_mends_what_a_wrong_one_spoils(made: Scene) -> None:
    """The number itself is hardly told apart from a lens-shaped relief, so it is the held-out error
    that counts.
    """
    path, values, poses = start(made)
    wrong = {
        **values,
        "camera.fx": values["camera.fx"] * 1.01,
        "camera.fy": values["camera.fy"] * 0.99,
    }
    held = fit_joint(path, wrong, made.observations, poses)
    freed = fit_joint(
        path, wrong, made.observations, poses, priors=Priors({"camera.fx": 30.0, "camera.fy": 30.0})
    )
    near = others((0.17, 0.3))
    assert set(freed.estimates()) == {"camera.fx", "camera.fy"}
    assert all(0 < number.sigma < 30 for number in freed.estimates().values()), (
        "the corners say more than the prior"
    )
    assert held_out(path, freed.values, near) < 0.8 * held_out(path, held.values, near)


def test_evidence_is_the_marginal_likelihood() -> None:
    """Brute force: with amplitudes and two correlated numbers integrated out, the residuals are
    normal with covariance sigma^2 I + J P^-1 J^T.
    """
    relief = Relief(*PATCH, (3, 4))
    rng = np.random.default_rng(0)
    jacobian = rng.normal(size=(40, 14)) * np.array([1e5] * 12 + [0.7, 2.0])
    residual = rng.normal(size=40)
    point = rng.normal(size=14) * np.array([1e-6] * 12 + [0.5, 0.3])
    of_two = np.array([[0.25, -0.14], [-0.14, 0.09]])  # correlated by -0.93
    quadratic = Quadratic.around(
        jacobian.T @ jacobian, jacobian.T @ residual, float(residual @ residual), 40, point
    )
    at_zero = residual - jacobian @ point  # linear: the residuals of the flat relief
    assert quadratic.cost == pytest.approx(at_zero @ at_zero)
    evidence = MarginalLikelihood(quadratic, relief, np.linalg.cholesky(of_two))
    together = MarginalLikelihood(
        quadratic,
        relief,
        np.linalg.cholesky(of_two),
        lambda smoothness: block_diag(smoothness.root(relief), np.linalg.cholesky(of_two)),
    )
    ours, theirs = [], []
    for sigma, smoothness in (
        (0.5, Smoothness(1e-5, 0.4)),
        (1.3, Smoothness(3e-6, 0.2)),
        (1.0, Smoothness(4e-5, 1.0)),
    ):
        ours.append(evidence.log(sigma, smoothness))
        assert together.log(sigma, smoothness) == pytest.approx(ours[-1], rel=1e-9)
        spread = block_diag(np.linalg.inv(smoothness.precision(relief)), of_two)
        covariance = sigma**2 * np.eye(40) + jacobian @ spread @ jacobian.T
        theirs.append(multivariate_normal(np.zeros(40), covariance).logpdf(at_zero))
    assert np.diff(ours) == pytest.approx(np.diff(theirs), rel=1e-5)


def test_evidence_of_a_fit_that_ended_early_is_that_of_its_error(
    made: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, values = covered_path(INTRINSICS, THIN)
    poses = pinhole_poses(path, values, made.observations)
    free = Priors(dict.fromkeys(("cover.thickness", "cover.inner_radius", "camera.fx"), 1.0))
    wrong = {**values, "cover.inner_radius": 1.5 * values["cover.inner_radius"]}
    arguments = (path, wrong, made.observations, poses)
    ended = fit_joint(*arguments, priors=free, rounds=[1e-6])
    monkeypatch.setattr("calib.estimation.joint_fit.MAX_ITERATIONS", 1)
    early = fit_joint(*arguments, priors=free, rounds=[1e-6])
    assert early.cost > 1.2 * ended.cost
    assert early.log_evidence < ended.log_evidence - (early.cost - ended.cost) / 4


def test_the_prior_s_heights_have_the_stated_spread() -> None:
    relief = Relief(*PATCH, (6, 5))
    smoothness = Smoothness(2e-5, 0.5)
    low, high = PATCH
    rows = torch.linspace(low[0], high[0], 6, dtype=torch.float64)
    columns = torch.linspace(low[1], high[1], 5, dtype=torch.float64)
    at = torch.cartesian_prod(rows, columns)
    level = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64).expand(30, 1, 3)
    heights = torch.empty(30, 1, 30, dtype=torch.float64)
    relief.spread(level, (at[:, 0], at[:, 1]), heights)
    spread = (
        heights[:, 0].numpy()
        @ np.linalg.inv(smoothness.precision(relief))
        @ heights[:, 0].numpy().T
    )

    def figure(item: tuple[float, float], two: tuple[float, float]) -> float:
        def term(i: int, k: int) -> float:
            return float(
                np.prod([eval_legendre(i, p[0]) * eval_legendre(k, p[1]) for p in (item, two)])
            )

        return sum(
            (3e-5 * 0.4 ** max(0, i + k - 2) if i + k else 1e-4) ** 2 * term(i, k)
            for i in range(11)
            for k in range(11 - i)
        )

    corner, neighbour = (-1.0, -1.0), (-1.0, -0.5)
    assert spread[0, 0] == pytest.approx(4e-10 + figure(corner, corner), rel=1e-4)
    assert spread[0, 1] == pytest.approx(
        4e-10 * np.exp(-((1 / 4) ** 2) / (2 * 0.25)) + figure(corner, neighbour), rel=1e-4
    )
