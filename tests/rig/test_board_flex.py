"""A board that bends differently in every placement: the joint fit against SciPy's on corners that
are bent another way, its products against its normal equations, and what a diagnosis finds.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy.optimize import least_squares

from calib.effects.board_flex import BoardFlex
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from calib.rig.check_rig import check_rig
from calib.rig.diagnose_rig import diagnose_rig
from calib.rig.evaluate_rig import evaluate_rig
from calib.rig.fit_rig import fit_rig
from calib.rig.joint_estimate import RigState, estimate_rig
from calib.rig.judge import judge_rig
from calib.rig.motion_products import MotionProducts
from calib.rig.own_effects import WideState, with_effects
from calib.rig.poses import move_points
from calib.rig.rig import Rig
from calib.rig.rig_finding import RigDiagnosis
from calib.rig.rig_result import state_of
from calib.session.board import Board
from fixtures.measured_pairs import SHARED_DATA, write_parts
from fixtures.rig_bends import bend_sigmas, bent_points, with_bends
from fixtures.rigs import SimulatedRig, simulate_rig, with_pictures
from tests.rig.conftest import BOARD, EVEN, WINDOW
from tests.rig.test_problem import close, initial_state

Array = NDArray[np.float64]
SHEET = Board(9, 7, 0.025)
"""Each half of its corners determines a bend."""
BEND = 3e-4
"""m"""


def bent_state(seed: int, placements: int, free: tuple[str, ...] = ()) -> RigState:
    """Return a state with bends of the board, at zero, of a rig that sees a bending sheet."""
    rig = simulate_rig(
        seed, WINDOW, placements=placements, amplitude=0.0, noise_px=0.02, board=BOARD
    )
    rig = with_bends(np.random.default_rng(seed), rig, BEND)
    state = replace(initial_state(rig, {}, free), baseline=None)
    return with_effects(state, [(BoardFlex(*BOARD.half),)] * len(state.cameras)).state


@pytest.mark.slow
def test_optimum_is_that_of_scipy_on_bent_corners() -> None:
    """SciPy minimises reprojection errors, from `project`, over poses and bends, whose heights are
    sums of Legendre polynomials.
    """
    free = ("camera.fx", "cover.distance")
    state = bent_state(11, 2, free)
    estimate = estimate_rig(state, rounds=(1e-8, 1e-12))
    layout = state.layout
    spreads = np.array([bend_sigmas(5e-4)] * 2)
    flat = BOARD.points()

    def residual(point: Array) -> Array:
        vector = torch.from_numpy(point[: layout.count])
        placements = point[layout.count :].reshape(2, 18)
        solids = [bent_points(flat, bend) for bend in placements[:, 6:]]
        rows = [(placements[:, 6:] / spreads).ravel()]
        for index, camera in enumerate(state.cameras):
            values = dict(camera.model.means)
            names = [param.name for param in camera.model.parameters.free]
            scales = [param.scale for param in camera.model.parameters.free]
            for name, scale, entry in zip(
                names, scales, vector[layout.columns[index]], strict=True
            ):
                values[name] = values[name] + scale * entry
                rows.append(np.array([float(scale * entry) / camera.model.priors.sigmas[name]]))
            entries = layout.mountings[index]
            mounting = state.nominal[index].clone()
            if len(entries):
                mounting += vector[entries]
            points = torch.cat(
                [
                    move_points(torch.from_numpy(place[:6]), torch.from_numpy(solid))
                    for place, solid in zip(placements, solids, strict=True)
                ]
            )
            observed = camera.observations
            moved = move_points(mounting, points)
            pixels = project(camera.model.path, values, moved, MIDDLE, start=observed.pixels)
            rows.append(((pixels - observed.pixels) / camera.sigma).numpy().ravel())
        return np.concatenate(rows)

    start = np.concatenate([state.vector().numpy(), state.placements.flatten().numpy()])
    oracle = least_squares(residual, start, x_scale="jac", xtol=1e-12, ftol=1e-12, gtol=1e-9)
    sigma = estimate.covariance.diagonal().sqrt().numpy()
    error = estimate.state.vector().numpy() - oracle.x[: layout.count]
    assert np.abs(error / sigma).max() < 0.03, "both weigh the residuals alike to first order"
    bends = oracle.x[layout.count :].reshape(2, 18)[:, 6:]
    assert np.abs(estimate.state.placements[:, 6:].numpy() - bends).max() < 2e-6
    assert np.abs(bends).max() > 1e-4
    jacobian = np.asarray(oracle.jac)
    expected = np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian))[: layout.count])
    assert np.abs(sigma / expected - 1).max() < 0.01


def test_products_of_a_fit_with_bends_are_its_normal_equations() -> None:
    """The rig's numbers have the same information and gradient, with poses and bends integrated
    out: the prior of the bends counts once, not once for each camera.
    """
    state = bent_state(12, 3)
    rng = np.random.default_rng(0)
    placements = state.placements.clone()
    placements[:, 6:] = torch.from_numpy(rng.normal(0, 1e-4, (3, 12)))
    state = replace(state, placements=placements)
    products = MotionProducts.of(WideState(state, np.arange(len(state.vector())), ()))
    problem = state.problem()
    cameras = tuple(
        replace(camera, landing=replace(camera.landing, huber=torch.inf))
        for camera in problem.cameras
    )
    problem = replace(problem, cameras=cameras)
    rows = problem.linearisation(state.vector(), placements).equations
    with_prior = replace(
        rows,
        hessian_block=rows.hessian_block + problem.block_precision.diag(),
        gradient_block=rows.gradient_block + problem.block_precision * placements,
    )
    reduced = with_prior.eliminate_blocks(0.0)
    numbers = products.numbers
    hessian = torch.from_numpy(products.total[np.ix_(numbers, numbers)])
    scale = reduced.hessian.diagonal().sqrt()
    assert close(hessian, reduced.hessian, scale[:, None] * scale)
    gradient = torch.from_numpy(products.total[numbers, -1])
    assert close(gradient, reduced.gradient, scale * float(products.total[-1, -1]) ** 0.5)


@pytest.fixture(scope="module")
def sheet(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, SimulatedRig]:
    """A pair that saw a bending sheet, with other placements in `holdout`."""
    folder = tmp_path_factory.mktemp("sheet")
    rng = np.random.default_rng(101)
    bare = simulate_rig(101, WINDOW, placements=1, amplitude=0.0, board=SHEET)
    held_out = with_bends(rng, with_pictures(rng, bare, 6), BEND)
    held_out.write(folder / "holdout")
    rig = with_bends(rng, with_pictures(rng, bare, 16), BEND)
    rig.write(folder / "rig")
    return folder, rig


@pytest.fixture(scope="module")
def diagnosed(sheet: tuple[Path, SimulatedRig]) -> tuple[Rig, Rig, RigDiagnosis]:
    """The fit of that pair, the diagnosed rig, and the diagnosis."""
    fitted = fit_rig(sheet[0] / "rig", EVEN)
    return fitted, *diagnose_rig(fitted)


@pytest.mark.slow
def test_a_bending_sheet_is_found(diagnosed: tuple[Rig, Rig, RigDiagnosis]) -> None:
    fitted, better, diagnosis = diagnosed
    assert diagnosis.accepted == ("board_flex",)
    (effect,) = diagnosis.found
    assert (effect.camera, effect.varies) == ("", "each_view")
    assert "the board bends differently in every placement, by 0." in effect.sentence
    number = effect.parameters["board_flex.xx"]
    assert abs(number.value - BEND) < 4 * number.sigma < 3e-4
    assert diagnosis.after.held_out_px < 0.45 * diagnosis.before.held_out_px
    assert not diagnosis.families
    assert all(c.corner_sigma_px < 0.12 for c in better.calibrations.values())
    assert all(c.corner_sigma_px > 0.2 for c in fitted.calibrations.values())
    words = " ".join(reason.sentence for reason in judge_rig(better).reasons)
    assert "bend" not in words
    assert "scatter" not in words


@pytest.mark.slow
def test_lengths_are_better_and_as_sure_as_stated(
    sheet: tuple[Path, SimulatedRig], diagnosed: tuple[Rig, Rig, RigDiagnosis]
) -> None:
    fitted, better, _ = diagnosed
    points, pixels = sheet[1].points(5, 200)
    pairs = np.arange(200).reshape(-1, 2)
    true = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
    rigid, _ = fitted.distances(pixels, pairs, 0.0)
    bent, sigma = better.distances(pixels, pairs, 0.0)
    assert rms(bent - true) < 0.5 * rms(rigid - true)
    assert 0.3 < rms((bent - true) / sigma) < 2


@pytest.mark.slow
def test_held_out_placements_bend_too(
    sheet: tuple[Path, SimulatedRig], diagnosed: tuple[Rig, Rig, RigDiagnosis]
) -> None:
    """Each half of the corners is measured with the bend that the other half gives."""
    fitted, better, _ = diagnosed
    rigid = evaluate_rig(fitted, sheet[0] / "holdout")
    bent = evaluate_rig(better, sheet[0] / "holdout")
    assert bent.rms_px < 0.2 < 0.55 * rigid.rms_px
    assert bent.rms_px > 0.141, "no fit of a corner to itself"
    assert all(band.normalised < 2 for band in bent.lengths)


@pytest.mark.slow
def test_the_bends_are_stored_with_the_cameras(
    diagnosed: tuple[Rig, Rig, RigDiagnosis], tmp_path: Path
) -> None:
    _, better, diagnosis = diagnosed
    assert better.bends.shape == (16, 12)
    assert better.placements.shape == (16, 6)
    better.save(tmp_path / "rig")
    loaded = Rig.load(tmp_path / "rig")
    assert np.array_equal(loaded.bends, better.bends)
    assert loaded.record.effects == better.record.effects
    state = state_of(loaded)
    for index, calibration in enumerate(loaded.calibrations.values()):
        assert np.allclose(state.poses(index).numpy(), calibration.poses, atol=1e-12)
    repeated, second = diagnose_rig(loaded)
    assert second.accepted == ()
    assert repeated is loaded
    assert "board_flex" not in {candidate.effect for candidate in second.candidates}
    assert second.before.held_out_px == pytest.approx(diagnosis.after.held_out_px, rel=0.02)


@pytest.mark.slow
def test_a_check_allows_for_other_bends(
    sheet: tuple[Path, SimulatedRig], diagnosed: tuple[Rig, Rig, RigDiagnosis]
) -> None:
    result = check_rig(diagnosed[1], sheet[0] / "holdout")
    assert result.status.value == "valid"
    assert result.statistics
    assert result.statistics.error_px < 0.15


@pytest.mark.slow
def test_a_bending_sheet_of_stereo_air(tmp_path: Path) -> None:
    """The sheet bends by 1.1 mm; each camera alone says so too."""
    folder = SHARED_DATA / "stereo-air"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not here")
    write_parts(folder, tmp_path)
    fitted = fit_rig(tmp_path / "train")
    better, diagnosis = diagnose_rig(fitted)
    assert diagnosis.accepted[0] == "board_flex"
    rigid = evaluate_rig(fitted, tmp_path / "holdout")
    bent = evaluate_rig(better, tmp_path / "holdout")
    assert bent.rms_px < 0.45 * rigid.rms_px


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
