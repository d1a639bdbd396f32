"""The parts of a rig's diagnosis against oracles: evidence against a dense Gaussian, derivatives
against central differences, and the board's speed against the path that it took.
"""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.stats import multivariate_normal

from calib.rig.board_motion import BoardMotion, find_bursts, motion_in_placement, placement_times
from calib.rig.joint_estimate import RigState
from calib.rig.motion_evidence import FixedMotion, RandomMotion, ReducedMotions, realign
from calib.rig.motion_products import MOTIONS, POSE, MotionProducts
from calib.rig.own_effects import WideState
from calib.rig.pose_terms import PoseTerms
from calib.rig.poses import compose
from calib.rig.problem import RigProblem
from fixtures.rig_motion import HandPath
from fixtures.rigs import simulate_rig
from tests.rig.conftest import BOARD, WINDOW
from tests.rig.test_problem import close, initial_state

Array = NDArray[np.float64]
STEP = 1e-6
WIDE = 1e3
"""The standard deviation of a placement that is as good as unknown."""


@pytest.fixture(scope="module")
def state() -> RigState:
    rig = simulate_rig(5, WINDOW, placements=3, amplitude=0.0, board=BOARD)
    return replace(initial_state(rig, {"right": [0, 2]}), baseline=None)


def test_terms_of_poses_agree_with_central_differences(state: RigState) -> None:
    rng = np.random.default_rng(0)
    right = state.cameras[1]
    shape = len(right.placement), 6, 2
    terms = PoseTerms(
        torch.tensor([0, 1]),
        torch.from_numpy(rng.normal(size=shape)),
        torch.from_numpy(rng.normal(size=shape)),
    )
    wide = replace(
        state,
        cameras=(state.cameras[0], replace(right, terms=terms)),
        numbers=torch.tensor([1e-3, -2e-3], dtype=torch.float64),
        spreads=torch.tensor([1.0, 2.0], dtype=torch.float64),
    )
    problem = wide.problem()
    cameras = tuple(
        replace(camera, landing=replace(camera.landing, huber=torch.inf))
        for camera in problem.cameras
    )
    problem = replace(problem, cameras=cameras)
    vector = wide.vector()
    columns = []
    for index in range(len(vector)):
        step = torch.zeros_like(vector)
        step[index] = STEP
        ahead = stacked_rows(problem, vector + step, wide)
        columns.append((ahead - stacked_rows(problem, vector - step, wide)) / (2 * STEP))
    jacobian = torch.stack(columns, 1)
    rows = problem.linearisation(vector, wide.placements).equations
    scale = (jacobian**2).sum(0).sqrt()
    assert bool((scale[-2:] > 0).all())
    assert close(rows.hessian_shared, jacobian.mT @ jacobian, scale[:, None] * scale)
    gradient = jacobian.mT @ stacked_rows(problem, vector, wide)
    length = float(stacked_rows(problem, vector, wide).norm())
    assert close(rows.gradient_shared, gradient, scale * length)
    assert problem.precision[-2:, -2:].diagonal().tolist() == [1.0, 0.25]
    same = wide.at(vector, wide.placements)
    assert torch.equal(same.poses(1), wide.poses(1))


def stacked_rows(problem: RigProblem, vector: torch.Tensor, state: RigState) -> torch.Tensor:
    rows = [
        camera.landing.residual(vector[camera.columns], camera.compose(vector, state.placements))[
            0
        ].flatten()
        for camera in problem.cameras
    ]
    return torch.cat(rows)


def test_motions_are_those_of_a_camera_and_of_the_board(state: RigState) -> None:
    """The score of each motion is the slope of the squares by a rig whose mounting, or whose board,
    is really moved.
    """
    products = MotionProducts.of(WideState(state, np.arange(len(state.vector())), ()))
    right = products.motions["right"]
    assert right.stop - right.start == MOTIONS
    score = products.products[:, right, -1].sum(0)

    def squares(motion: Array) -> float:
        mounting = compose(torch.from_numpy(motion[:6]), state.mountings[1])
        problem = state.problem()
        camera = problem.cameras[1]
        placements = state.placements[camera.placement].clone()
        turned = placements.clone()
        turned[:, 3:] = 0.0
        turn = torch.from_numpy(np.r_[motion[6:9], np.zeros(3)])
        placements[:, :3] = compose(turn, turned)[:, :3]
        placements[:, 3:] += torch.from_numpy(motion[9:])
        residual, _ = camera.landing.residual(
            state.vector()[camera.columns], compose(mounting, placements)
        )
        return float((residual**2).sum())

    # Beyond Huber's limit corners weigh less: the start is some sigmas off, below the limit used.
    for index in range(MOTIONS):
        step = np.zeros(MOTIONS)
        step[index] = STEP
        slope = (squares(step) - squares(-step)) / (4 * STEP)
        scale = products.products[:, right, right].sum(0)[index, index] ** 0.5
        assert abs(score[index] - slope) < 1e-4 * scale * squares(np.zeros(MOTIONS)) ** 0.5


def random_products(rng: np.random.Generator) -> tuple[MotionProducts, list[Array], list[Array]]:
    """Return products of random rows, with these rows and their residuals."""
    numbers, places, rows = 3, 4, 30
    columns = 6 + numbers + MOTIONS
    jacobians = [rng.normal(size=(rows, columns)) for _ in range(places)]
    residuals = [rng.normal(size=rows) for _ in range(places)]
    stacked = [
        np.column_stack([jacobian, residual])
        for jacobian, residual in zip(jacobians, residuals, strict=True)
    ]
    products = np.array([rows.T @ rows for rows in stacked])
    vector = rng.normal(size=numbers)
    return (
        MotionProducts(
            products=products,
            halves=np.array([products, products]) / 2,
            blocks=np.zeros((places, 6)),
            block_precision=np.zeros(6),
            bends=slice(columns, columns),
            numbers=6 + np.arange(numbers),
            own_effects=(),
            motions={"right": slice(6 + numbers, columns)},
            vector=vector,
            precision=np.diag([1.0, 2.0, 3.0]),
            imitations={},
            corners={},
        ),
        jacobians,
        residuals,
    )


def test_the_evidence_is_that_of_a_dense_gaussian() -> None:
    """The residual's probability from its whole covariance, with a wide prior of the placements."""
    rng = np.random.default_rng(1)
    source, jacobians, residuals = random_products(rng)
    motion = slice(9, 15)
    roots = rng.normal(size=(4, 6, 6))
    spread = np.array([0.7, 1.3])
    by_number = rng.normal(size=(4, 6, 2))
    fixed = FixedMotion(slice(15, 21), by_number, spread)
    random = RandomMotion(motion, roots)

    def dense(*, with_random: bool, with_fixed: bool) -> float:
        size = sum(len(residual) for residual in residuals)
        covariance = np.eye(size)
        shared = np.concatenate([jacobian[:, 6:9] for jacobian in jacobians])
        mean = shared @ source.vector  # the rig's numbers have their prior around zero
        covariance += shared @ np.diag(1 / np.diag(source.precision)) @ shared.T
        first = 0
        moved = []
        for place, jacobian in enumerate(jacobians):
            rows = slice(first, first + len(jacobian))
            first += len(jacobian)
            poses = jacobian[:, POSE]
            covariance[rows, rows] += WIDE**2 * poses @ poses.T
            if with_random:
                drawn = jacobian[:, motion] @ roots[place]
                covariance[rows, rows] += drawn @ drawn.T
            moved.append(jacobian[:, fixed.columns] @ by_number[place])
        if with_fixed:
            columns = np.concatenate(moved) * spread
            covariance += columns @ columns.T
        value = np.concatenate(residuals)
        return float(multivariate_normal(mean, covariance).logpdf(value))

    plain = ReducedMotions.of(source)
    drawn = ReducedMotions.of(source, [random])
    gain = drawn.log_evidence - plain.log_evidence
    expected = dense(with_random=True, with_fixed=False) - dense(
        with_random=False, with_fixed=False
    )
    assert gain == pytest.approx(expected, abs=1e-3)
    estimate = drawn.estimate(fixed)
    expected = dense(with_random=True, with_fixed=True) - dense(with_random=True, with_fixed=False)
    assert estimate.log_evidence == pytest.approx(expected, abs=1e-3)


def test_the_numbers_are_those_of_least_squares() -> None:
    rng = np.random.default_rng(2)
    source, jacobians, residuals = random_products(rng)
    by_number = rng.normal(size=(4, 6, 1))
    fixed = FixedMotion(slice(15, 21), by_number, np.array([1e6]))
    rows = []
    for place, jacobian in enumerate(jacobians):
        poses = np.zeros((len(jacobian), 24))
        poses[:, 6 * place : 6 * place + 6] = jacobian[:, POSE]
        rows.append(
            np.column_stack([poses, jacobian[:, 6:9], jacobian[:, 15:21] @ by_number[place]])
        )
    prior = np.column_stack([np.zeros((3, 24)), source.precision**0.5, np.zeros((3, 1))])
    matrix = np.concatenate([*rows, prior])
    right = np.concatenate([*residuals, source.precision.diagonal() ** 0.5 * source.vector])
    expected, *_ = np.linalg.lstsq(matrix, -right, rcond=None)
    reduced = ReducedMotions.of(source)
    estimate = reduced.estimate(fixed)
    assert estimate.value == pytest.approx(expected[-1:], rel=1e-6)
    step = reduced.step(fixed, estimate.value)
    assert step == pytest.approx(expected[24:27], rel=1e-6)
    covariance = np.linalg.inv(matrix.T @ matrix)[-1:, -1:]
    assert estimate.covariance == pytest.approx(covariance, rel=1e-6)


def test_the_speed_of_the_board_is_that_of_its_path() -> None:
    """The motion in 8 ms and its standard deviation, against the path that was simulated."""
    rng = np.random.default_rng(3)
    later = 8e-3
    placements, moved, times = [], [], []
    for burst in range(6):
        path = HandPath.draw(rng, (0.5, 1.0), 0.2)
        for frame in range(8):
            time = frame / 15
            pose, later_pose = path.at(time), path.at(time + later)
            noise = torch.from_numpy(rng.normal(0, 1, 6) * np.repeat([2e-4, 5e-5], 3))
            placements.append((pose + noise).numpy())
            # The turn about the axes of the reference, from the derivatives of the numbers.
            to_motion = np.linalg.inv(motion_in_placement(pose.numpy()[None]))[0]
            moved.append(to_motion @ (later_pose - pose).numpy())
            times.append(100.0 * burst + time)
    covariance = np.diag(np.repeat([2e-4, 5e-5], 3) ** 2)
    count = len(placements)
    motion = BoardMotion.of(
        np.array(placements), np.tile(covariance, (count, 1, 1)), np.array(times)
    )
    assert len(motion.bursts) == 6
    displacement = motion.after(later)
    assert displacement.is_known.all()
    error = displacement.mean - np.array(moved)
    assert np.linalg.norm(error) < 0.2 * np.linalg.norm(moved)
    sigma = np.sqrt(displacement.covariance.diagonal(axis1=1, axis2=2))
    # A sine is smoother than the process, which is rather too careful than too sure.
    assert 0.3 < np.sqrt(np.mean((error / sigma) ** 2)) < 1.3
    assert np.array(motion.speeds) == pytest.approx((0.6, 0.2), rel=0.5)


def test_a_lateness_without_noise_is_true() -> None:
    """The regression of the true motions on the predicted ones, from exact placements."""
    rng = np.random.default_rng(4)
    late_s, covariance = 8e-3, np.diag(np.repeat([1.5e-4, 3e-5], 3) ** 2)
    placements, shifts, times = [], [], []
    for burst in range(8):
        path = HandPath.draw(rng, (0.4, 1.2), 0.15)
        for frame in range(5):
            pose, later_pose = path.at(frame / 15), path.at(frame / 15 + late_s)
            placements.append(pose.numpy())
            shifts.append((later_pose - pose).numpy()[3:])
            times.append(100.0 * burst + frame / 15)
    covariances = np.tile(covariance, (len(placements), 1, 1))
    motion = BoardMotion.of(np.array(placements), covariances, np.array(times))
    assert motion.interval_s == pytest.approx(1 / 15)
    moved = motion.after(late_s)
    weights = np.linalg.inv(moved.covariance + 2 * covariances)[:, 3:, 3:]
    predicted = moved.mean[:, 3:]
    product = np.einsum("pi,pij,pj", predicted, weights, np.array(shifts))
    ratio = product / np.einsum("pi,pij,pj", predicted, weights, predicted)
    assert ratio == pytest.approx(1.0, abs=2.5e-3)


def test_random_motions_stay_those_of_their_camera_in_a_later_fit() -> None:
    """A fit with more numbers has the columns of all motions further on."""
    products, _, _ = random_products(np.random.default_rng(4))
    (place,) = products.motions.values()
    board = RandomMotion(slice(place.stop - 6, place.stop), np.zeros((4, 6, 6)))
    later = replace(products, motions={"right": slice(place.start + 2, place.stop + 2)})
    (moved,) = realign((board,), products, later)
    assert moved.columns == slice(place.stop - 4, place.stop + 2)
    assert realign((board,), products, products)[0].columns == board.columns


def test_bursts_are_placements_at_short_intervals() -> None:
    times = np.array([5.1, 0.0, 0.1, 5.0, 0.2, np.nan, 5.2, 9.0, 9.1])
    first, second = find_bursts(times)
    assert first.places.tolist() == [1, 2, 4]
    assert second.places.tolist() == [3, 0, 6]
    assert second.times == pytest.approx([0.0, 0.1, 0.2])
    assert find_bursts(np.full(4, np.nan)) == ()
    assert [len(burst.places) for burst in find_bursts(np.linspace(0.0, 9.9, 100))] == [34, 33, 33]
    unmoved = BoardMotion.of(np.zeros((3, 6)), np.zeros((3, 6, 6)), np.full(3, np.nan))
    assert not unmoved.after(0.01).is_known.any()
    assert np.isnan(unmoved.interval_s)


def test_times_are_those_of_the_camera_that_has_most() -> None:
    first, second = np.array([0, 1]), np.array([0, 1, 2])
    times = placement_times(
        [first, second], [np.array([7.0, np.nan]), np.array([1.0, 2.0, 3.0])], 3
    )
    assert times.tolist() == [1.0, 2.0, 3.0]
