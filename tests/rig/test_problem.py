"""The problem of a rig: its blocks by the chain rule against central differences, and its optimum
against SciPy's on residuals that are built another way.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares
from torch import Tensor

from calib.effects.board_flex import BoardFlex
from calib.estimation.camera_model import CameraModel
from calib.estimation.levenberg_marquardt import minimise
from calib.estimation.observations import Observations
from calib.estimation.stated_priors import priors_of
from calib.optics.build import covered_path
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.rig.joint_estimate import CameraState, RigState, estimate_rig
from calib.rig.layout import RigLayout
from calib.rig.own_effects import with_effects
from calib.rig.poses import compose, move_points
from calib.rig.problem import BaselinePrior, RigProblem
from fixtures.rigs import SimulatedRig, simulate_rig
from tests.rig.conftest import BOARD, WINDOW

STEP = 1e-6


@pytest.fixture(scope="module")
def state() -> RigState:
    """Three cameras at the numbers that their sessions declare; the third misses two placements."""
    rig = simulate_rig(
        5, WINDOW, placements=5, amplitude=0.0, board=BOARD, names=("left", "right", "third")
    )
    return initial_state(rig, {"third": [1, 3, 4]})


def initial_state(
    rig: SimulatedRig, visible: dict[str, list[int]], free: tuple[str, ...] = ()
) -> RigState:
    """Return the state at the declared numbers, with poses near the true ones.

    Args:
        free: the estimated numbers; the others are held at the true ones. Empty for all.
    """
    rng = np.random.default_rng(0)
    cameras = []
    for name, camera in rig.cameras.items():
        path, means = covered_path(camera.intrinsics, camera.cover)
        priors = priors_of(camera.intrinsics, camera.cover, path)
        if free:
            priors = replace(priors, sigmas={name: priors.sigmas[name] for name in free})
            means = {**camera.values, **{name: means[name] for name in free}}
        model = CameraModel(path, means, priors)
        places = visible.get(name, list(range(len(rig.placements))))
        views = [rig.views[name][place] for place in places]
        observations = Observations.of(views, rig.board)
        placement = torch.tensor(places)
        cameras.append(CameraState(name, model, observations, placement, means, 0.1, None))
    mountings = torch.stack([camera.mounting for camera in rig.cameras.values()])
    noise = torch.from_numpy(rng.normal(0, 1e-3, rig.placements.shape))
    return RigState(
        cameras=tuple(cameras),
        layout=RigLayout.of(
            tuple(rig.cameras), [c.model for c in cameras], next(iter(rig.cameras))
        ),
        nominal=mountings,
        mountings=mountings,
        placements=rig.placements + noise,
        baseline=BaselinePrior(1, 0.0602, 1e-4),
    )


def stacked_residual(problem: RigProblem, shared: Tensor, placements: Tensor) -> Tensor:
    rows = [
        camera.landing.residual(shared[camera.columns], camera.compose(shared, placements))[0]
        for camera in problem.cameras
    ]
    baseline = problem.baseline_row(shared)
    assert baseline
    return torch.cat([*(row.flatten() for row in rows), torch.tensor([baseline[0]])])


def with_bends(state: RigState) -> RigState:
    """Return the state with a random bend of the board in each placement."""
    effect = BoardFlex(*BOARD.half)
    bent = with_effects(state, [(effect,)] * len(state.cameras)).state
    placements = bent.placements.clone()
    rng = np.random.default_rng(1)
    placements[:, 6:] = torch.from_numpy(rng.normal(0, 3e-4, placements[:, 6:].shape))
    return replace(bent, placements=placements)


@pytest.mark.parametrize("bends", [False, True], ids=["rigid", "bent"])
def test_blocks_agree_with_central_differences(state: RigState, bends: bool) -> None:
    state = with_bends(state) if bends else state
    problem = state.problem()
    # Without robust weights, the equations are the products of the derivatives alone.
    cameras = tuple(
        replace(camera, landing=replace(camera.landing, huber=torch.inf))
        for camera in problem.cameras
    )
    problem = replace(problem, cameras=cameras)
    shared, placements = state.vector(), state.placements
    size, count = len(shared), placements.shape[1]
    assert count == (18 if bends else 6)

    def residual(point: Tensor) -> Tensor:
        return stacked_residual(problem, point[:size], point[size:].reshape(-1, count))

    point = torch.cat([shared, placements.flatten()])
    columns = []
    for index in range(len(point)):
        step = torch.zeros_like(point)
        step[index] = STEP
        columns.append((residual(point + step) - residual(point - step)) / (2 * STEP))
    jacobian = torch.stack(columns, 1)
    assert bool((jacobian.abs().amax(0) > 0).all()), "every number moves some residual"
    expected = jacobian.mT @ jacobian
    gradient = jacobian.mT @ residual(point)
    length = float(residual(point).norm())
    rows = problem.linearisation(shared, placements).equations
    scale = expected.diagonal().sqrt()
    size_of = scale[:, None] * scale
    assert close(rows.hessian_shared, expected[:size, :size], size_of[:size, :size])
    for place in range(len(placements)):
        block = slice(size + count * place, size + count * (place + 1))
        assert close(rows.hessian_block[place], expected[block, block], size_of[block, block])
        assert close(rows.hessian_cross[place], expected[block, :size], size_of[block, :size])
        assert close(rows.gradient_block[place], gradient[block], scale[block] * length)
    assert close(rows.gradient_shared, gradient[:size], scale[:size] * length)


def close(value: Tensor, expected: Tensor, size: Tensor) -> bool:
    return float(((value - expected).abs() / size).max()) < 1e-5


@pytest.mark.parametrize("bends", [False, True], ids=["rigid", "bent"])
def test_inner_step_lowers_the_cost_of_each_placement(state: RigState, bends: bool) -> None:
    state = with_bends(state) if bends else state
    problem = state.problem()
    shared = state.vector()
    cost_before = problem.cost(shared, state.placements)
    blocks, cost_after = problem.inner_step(shared, state.placements)
    assert cost_after < 0.9 * cost_before
    assert bool((blocks**2 @ problem.block_precision > 0).all()) == bends
    assert abs(problem.cost(shared, blocks) - cost_after) < 1e-9 * cost_after


def test_acceleration_follows_the_bend_of_the_residuals(state: RigState) -> None:
    """J^T r'' by differences of the residuals along a move in which no pose bends."""
    problem = replace(state.problem(), baseline=None)
    shared, placements = state.vector(), state.placements
    move = torch.zeros_like(shared)
    move[state.layout.columns[0]] = 1e-3
    standstill = torch.zeros_like(placements)
    by_block, by_shared = problem.linearisation(shared, placements).curvature_gradient(
        (move, standstill)
    )
    assert by_block.shape == placements.shape
    assert float(by_shared[state.layout.columns[0]].abs().max()) > 0
    assert float(by_shared[state.layout.columns[1]].abs().max()) < 1e-9


@pytest.mark.slow
def test_optimum_is_that_of_scipy_on_projected_corners() -> None:
    """SciPy minimises reprojection errors, from `project`, over free 6-number poses; the rig
    minimises where rays land, in image units, by eliminated placements.
    """
    rig = simulate_rig(11, WINDOW, placements=2, amplitude=0.0, noise_px=0.02, board=BOARD)
    free = ("camera.fx", "camera.cy", "cover.distance", "cover.tilt.x")
    state = replace(initial_state(rig, {}, free), baseline=None)
    estimate = estimate_rig(state, rounds=(1e-8, 1e-12))
    layout = state.layout
    names = [[param.name for param in c.model.parameters.free] for c in state.cameras]
    nominal = state.mountings[1]

    def residual(point: NDArray[np.float64]) -> NDArray[np.float64]:
        vector = torch.from_numpy(point)
        shared, placements = vector[: layout.count], vector[layout.count :].reshape(-1, 6)
        rows = []
        for index, camera in enumerate(state.cameras):
            values = dict(camera.model.means)
            entries = shared[layout.columns[index]]
            priors = camera.model.priors.sigmas
            for name, entry, param in zip(
                names[index], entries, camera.model.parameters.free, strict=True
            ):
                values[name] = values[name] + param.scale * entry
                rows.append((param.scale * entry / priors[name]).reshape(1))
            mounting = nominal + shared[layout.mountings[1]] if index else torch.zeros(6).double()
            observed = camera.observations
            flat = torch.cat([observed.corners, torch.zeros(len(observed.corners), 1)], 1)
            boards = zip(placements, observed.per_view(flat), strict=True)
            points = torch.cat([move_points(placement, board) for placement, board in boards])
            projected = project(
                camera.model.path,
                values,
                move_points(mounting, points),
                MIDDLE,
                start=observed.pixels,
            )
            rows.append((projected - observed.pixels).flatten() / camera.sigma)
        return torch.cat(rows).numpy()

    start = np.concatenate([state.vector().numpy(), rig.placements.flatten().numpy()])
    oracle = least_squares(residual, start, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-9)
    sigma = estimate.covariance.diagonal().sqrt().numpy()
    vector = estimate.state.vector().numpy()
    error = np.abs(vector - oracle.x[: layout.count]) / sigma
    assert error.max() < 0.02, "both weigh the residuals alike to first order"
    jacobian = np.asarray(oracle.jac)
    oracle_covariance = np.linalg.inv(jacobian.T @ jacobian)
    ratio = sigma / np.sqrt(np.diag(oracle_covariance)[: layout.count])
    assert np.abs(ratio - 1).max() < 0.01


def test_measured_baseline_is_a_prior() -> None:
    rig = simulate_rig(12, WINDOW, placements=3, amplitude=0.0, board=BOARD)
    state = replace(initial_state(rig, {}), baseline=None)
    free = estimate_rig(state).state.mountings[1, 3:].norm()
    informed = estimate_rig(replace(state, baseline=BaselinePrior(1, 0.0605, 1e-7)))
    assert abs(float(free) - 0.0605) > 1e-4
    assert abs(float(informed.state.mountings[1, 3:].norm()) - 0.0605) < 1e-6


def test_placements_of_one_camera_alone_count() -> None:
    """A picture that only one camera took makes that camera's numbers more certain."""
    rig = simulate_rig(13, WINDOW, placements=6, amplitude=0.0, board=BOARD)
    state = replace(initial_state(rig, {"right": [0, 1, 2]}), baseline=None)
    smaller = replace(initial_state(rig, {"left": [0, 1, 2], "right": [0, 1, 2]}), baseline=None)
    smaller = smaller.select_placements(range(3))
    focal = state.cameras[0].model.parameters.slices()["camera.fx"].start
    larger = estimate_rig(state).covariance[focal, focal]
    assert float(larger) < 0.9 * float(estimate_rig(smaller).covariance[focal, focal])


def test_equations_grow_with_the_placements_alone() -> None:
    """No array of the equations has the placements in two dimensions, or the corners in one."""
    for placements in (4, 8):
        rig = simulate_rig(14, WINDOW, placements=placements, amplitude=0.0, board=BOARD)
        state = initial_state(rig, {})
        rows = state.problem().linearisation(state.vector(), state.placements).equations
        count = state.layout.count
        assert rows.hessian_block.shape == (placements, 6, 6)
        assert rows.hessian_cross.shape == (placements, 6, count)
        assert rows.hessian_shared.shape == (count, count)


def test_minimum_does_not_depend_on_the_order_of_cameras() -> None:
    rig = simulate_rig(15, WINDOW, placements=4, amplitude=0.0, board=BOARD)
    state = replace(initial_state(rig, {}), baseline=None)
    problem = state.problem()
    first = minimise(problem, state.vector(), state.placements, tolerance=1e-12)
    swapped = replace(problem, cameras=problem.cameras[::-1])
    second = minimise(swapped, state.vector(), state.placements, tolerance=1e-12)
    assert abs(first.cost - second.cost) < 1e-9 * first.cost
    assert float((first.blocks - second.blocks).abs().max()) < 1e-7
    poses = compose(problem.cameras[1].mounting_at(first.shared), first.blocks)
    assert float(poses[:, 5].min()) > 0
