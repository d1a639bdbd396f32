"""The information of views about the shared parameters, compared with independent oracles; and the
process that computes it.
"""

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from calib.apply.map_uncertainty import predicted_sigma
from calib.corners.view import View
from calib.estimation.jacobians import undistorted_jacobian
from calib.estimation.normal_equations import normal_equations
from calib.estimation.observations import Observations
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.estimation.stated_priors import priors_of
from calib.estimation.surface_prior import Smoothness
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.optics.exposure import MIDDLE
from calib.planning.information import PlanningFit, estimate, survey, view_information
from calib.planning.pose_bank import Reach, make_pose_bank
from calib.session.camera import Camera
from calib.session.coding import Charuco
from calib.session.cover import Cover
from calib.session.freeing import free_parameters
from capture.coverage import COVERAGE_CELLS, InformedGuide, KeptView
from capture.guidance import Guidance, GuidanceError, Request, answers
from fixtures.calibrated import CAMERA, GLASS, calibrate
from fixtures.synthetic import INTRINSICS, Scene, scene

GRID = (8, 8)
REACH = Reach(0.6, 1.2)
DEPTHS = REACH.levels()


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(31, 12, noise=0.1, cover=GLASS)


@pytest.fixture(scope="module")
def setup(made: Scene) -> Setup:
    """Thickness and focal length are estimated too."""
    return Setup(
        made.board, CAMERA, *free_parameters(INTRINSICS, GLASS, ("thickness", "intrinsics"))
    )


@pytest.fixture(scope="module")
def small_fit(made: Scene, setup: Setup) -> PlanningFit:
    return estimate(setup, made.views[:2], GRID)


def some_poses() -> np.ndarray:
    return make_pose_bank(scene(1, 1).board, CAMERA, REACH).poses[::12]


def test_the_jacobian_is_central_differences_of_rays(small_fit: PlanningFit) -> None:
    model = small_fit.model
    pixels = np.array([[300.0, 200], [1600, 1200], [3000, 2300]])
    jacobian, motions, failed = undistorted_jacobian(model.path, model.parameters, pixels)
    assert not failed.any()
    places = model.parameters.slices()
    assert {"cover.thickness", "camera.fx"} <= set(places)

    def undistorted(
        values: dict[str, torch.Tensor], turn: np.ndarray, shift: np.ndarray
    ) -> np.ndarray:
        rays = model.path.trace(torch.from_numpy(pixels), values, MIDDLE)
        origin, direction = rays.origin.stacked().numpy(), rays.direction.stacked().numpy()
        origin, direction = (
            origin + np.cross(turn, origin) + shift,
            direction + np.cross(turn, direction),
        )
        slopes = direction[:, :2] / direction[:, 2:]
        coefficients = slopes, origin[:, :2] - slopes * origin[:, 2:]
        return np.asarray(INTRINSICS.fx.value * np.stack(coefficients, 1))

    def difference(change: dict[str, torch.Tensor], size: float) -> np.ndarray:
        ends = [
            undistorted(
                {**model.means, **{k: model.means[k] + s * v for k, v in change.items()}},
                ZERO,
                ZERO,
            )
            for s in (1, -1)
        ]
        return np.asarray((ends[0] - ends[1]) / (2 * size))

    bump = torch.zeros(GRID, dtype=torch.float64)
    bump[3, 4] = 1e-7
    by_bump = difference({"relief.amplitudes": bump}, 1e-7)
    assert jacobian[..., 3 * GRID[1] + 4] == pytest.approx(
        by_bump, rel=1e-5, abs=1e-5 * np.abs(by_bump).max()
    )
    thick = next(param.scale for param in model.parameters.free if param.name == "cover.thickness")
    by_thickness = difference(
        {"cover.thickness": torch.tensor(1e-4 * thick, dtype=torch.float64)}, 1e-4
    )
    column = places["cover.thickness"].start
    assert jacobian[..., column] == pytest.approx(
        by_thickness, rel=1e-4, abs=1e-4 * np.abs(by_thickness).max()
    )
    for axis in range(6):
        step = 1e-6 * np.eye(6)[axis]
        ends = [
            undistorted(dict(model.means), sign * step[:3], sign * step[3:]) for sign in (1, -1)
        ]
        assert motions[..., axis] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-5, abs=1e-3)


ZERO = np.zeros(3)


def test_a_view_s_information_is_the_schur_complement_of_its_pose(small_fit: PlanningFit) -> None:
    """Oracle: the solver's own normal equations, each view by itself; and that they add up."""
    model, observations = small_fit.model, small_fit.observations
    weights = pixel_weights(model.path, model.means, observations, small_fit.poses, 1.0)
    ours = view_information(model, observations, small_fit.poses)
    pieces = make_residual_blocks(model.path, model.parameters, observations, weights)
    equations = normal_equations(piece.linearise(model.means, small_fit.poses) for piece in pieces)
    total = equations.eliminate_blocks().hessian
    assert ours.shape == (2, *total.shape)
    assert ours.sum(0) == pytest.approx(
        total.numpy(), rel=1e-6, abs=1e-6 * float(total.abs().max())
    )
    for item in ours:
        assert np.linalg.eigvalsh(item).min() > -1e-9 * np.abs(item).max()


def test_the_predicted_sigma_is_the_calibrations_own(made: Scene) -> None:
    """calib.apply takes out the motion at the training corners, the design over the whole picture,
    where it hides some more: with twelve views at random, a sixth.
    """
    setup = Setup(made.board, CAMERA, INTRINSICS, GLASS)
    design = estimate(setup, made.views, GRID).design(setup, some_poses(), COVERAGE_CELLS, DEPTHS)
    field = predicted_sigma(calibrate(made, Settings(grid=GRID)))
    assert field
    cell_rows, cell_columns = COVERAGE_CELLS
    x = (np.arange(cell_columns) + 0.5) / cell_columns * CAMERA.width - 0.5
    y = (np.arange(cell_rows) + 0.5) / cell_rows * CAMERA.height - 0.5
    theirs = np.stack([field.at(*np.meshgrid(x, y), depth) for depth in DEPTHS], -1)
    ours = np.sqrt(design.variance(design.precision()))
    assert 0.7 < np.median(ours / theirs) < 1


def test_neglected_modes_change_nothing(small_fit: PlanningFit, setup: Setup) -> None:
    """Oracle: the covariance of all shared parameters, without modes."""
    surveyed_design = small_fit.design(setup, some_poses(), COVERAGE_CELLS, DEPTHS)
    model = small_fit.model
    information = (
        view_information(model, small_fit.observations, small_fit.poses).sum(0) / small_fit.sigma**2
    )
    fixed = [
        (param.scale / float(model.priors.sigmas[param.name])) ** 2
        for param in model.parameters.free
    ]
    precision = np.zeros_like(information)
    assert model.path.relief
    amplitudes = GRID[0] * GRID[1]
    precision[:amplitudes, :amplitudes] = small_fit.smoothness.precision(model.path.relief)
    precision[amplitudes:, amplitudes:] = np.diag(fixed)
    covariance = np.linalg.inv(information + precision)
    cell_rows, cell_columns = COVERAGE_CELLS
    x = (np.arange(cell_columns) + 0.5) / cell_columns * CAMERA.width - 0.5
    y = (np.arange(cell_rows) + 0.5) / cell_rows * CAMERA.height - 0.5
    pixels = np.stack(np.meshgrid(x, y), -1).reshape(-1, 2)
    jacobian, motions, _ = undistorted_jacobian(model.path, model.parameters, pixels)
    at = np.stack([np.ones_like(DEPTHS), 1 / DEPTHS])
    changed = np.einsum("nabs,ad->ndbs", jacobian, at).reshape(-1, jacobian.shape[-1])
    moved = np.einsum("nabs,ad->ndbs", motions, at).reshape(-1, motions.shape[-1])
    remainder = changed - moved @ np.linalg.lstsq(moved, changed, rcond=None)[0]
    variance = np.einsum("ns,st,nt->n", remainder, covariance, remainder).mean() * 2
    assert surveyed_design.sigma(surveyed_design.precision()) == pytest.approx(
        np.sqrt(variance), rel=0.02
    )
    assert surveyed_design.information.shape[-1] < len(information)


def test_poses_that_the_cover_pushes_out_of_the_picture_are_dropped(
    small_fit: PlanningFit, setup: Setup
) -> None:
    poses = np.array([[0, 0, 0, 0, 0, 0.8], [0, 0, 0, 0.6, 0, 0.8]])
    design = small_fit.design(setup, poses, COVERAGE_CELLS, DEPTHS)
    assert design.poses == pytest.approx(poses[:1])


def test_visible_corners_of_a_board_with_markers_count(small_fit: PlanningFit, made: Scene) -> None:
    """Oracle: the same view with the other corners taken from its observations.

    A pose in which too little is seen is dropped.
    """
    board = replace(made.board, coding=Charuco(0.75 * made.board.square, "DICT_4X4_250"))
    half_out, far_out = np.array([0.1, -0.2, 0, 0.5, 0, 0.8]), np.array([0, 0, 0, 0.62, 0.46, 0.8])
    result = survey(
        small_fit.model, board, CAMERA, np.array([half_out, far_out]), COVERAGE_CELLS, DEPTHS
    )
    assert (
        len(
            survey(
                small_fit.model, made.board, CAMERA, np.array([half_out]), COVERAGE_CELLS, DEPTHS
            ).poses
        )
        == 0
    )
    assert result.poses == pytest.approx(half_out[None])
    visible = np.isfinite(result.corners[0, :, 0])
    assert 0.4 <= visible.mean() < 0.9
    assert (result.corners[0, visible] < [CAMERA.width - 1, CAMERA.height - 1]).all()
    view = View("", result.corners[0], visible.astype(float))
    full = Observations.of((view,), made.board)
    assert len(full.pixels) == visible.sum()
    assert result.information == pytest.approx(
        view_information(small_fit.model, full, torch.from_numpy(half_out[None])), rel=1e-6
    )


def test_the_bank_predicts_the_information_of_views_in_its_poses(setup: Setup) -> None:
    """A view taken exactly where the guide asked lowers sigma as the plan foresaw."""
    nominal = estimate(setup, (), GRID)
    design = nominal.design(setup, some_poses(), COVERAGE_CELLS, DEPTHS)
    first = design.plan(design.precision(), np.zeros(len(design.poses), bool), 0.0, limit=3)
    assert len(set(first)) == 3
    foreseen = design.sigma(design.precision(design.information[first].sum(0)))
    views = tuple(
        View(str(pose), design.corners[pose], np.ones(setup.board.count)) for pose in first
    )
    taken = estimate(setup, views, GRID).design(setup, some_poses(), COVERAGE_CELLS, DEPTHS)
    assert taken.sigma(taken.precision()) == pytest.approx(foreseen, rel=0.01)
    assert foreseen < 0.2 * design.sigma(design.precision())


def test_planned_views_beat_others(setup: Setup) -> None:
    design = estimate(setup, (), GRID).design(setup, some_poses(), COVERAGE_CELLS, DEPTHS)
    planned = design.plan(design.precision(), np.zeros(len(design.poses), bool), 0.0, limit=8)
    best = design.sigma(design.precision(design.information[planned].sum(0)))
    rng = np.random.default_rng(0)
    alternatives = [
        design.sigma(
            design.precision(design.information[rng.permutation(len(design.poses))[:8]].sum(0))
        )
        for _ in range(20)
    ]
    assert best < min(alternatives)


def test_a_rougher_prior_and_more_noise_make_maps_less_certain(
    small_fit: PlanningFit, setup: Setup
) -> None:
    def sigma(height: float, noise: float) -> float:
        changed = PlanningFit(
            small_fit.model, small_fit.poses, small_fit.observations, Smoothness(height, 0.4), noise
        )
        design = changed.design(setup, some_poses()[:3], COVERAGE_CELLS, DEPTHS)
        return design.sigma(design.precision())

    assert sigma(1e-5, 0.1) < sigma(3e-5, 0.1)
    assert sigma(1e-5, 0.1) < sigma(1e-5, 0.2)


def test_enough_views_are_fitted(made: Scene) -> None:
    setup = Setup(made.board, CAMERA, INTRINSICS, GLASS)
    reference = estimate(setup, made.views, GRID)
    assert reference.sigma == pytest.approx(0.1, rel=0.1)
    assert float(reference.model.means["relief.amplitudes"].abs().max()) > 1e-7


def test_parameters_without_a_sigma_are_not_estimated(made: Scene, setup: Setup) -> None:
    reference = estimate(Setup(made.board, CAMERA, INTRINSICS, GLASS), (), GRID)
    assert reference.model.parameters.free == ()
    assert {param.name for param in estimate(setup, (), GRID).model.parameters.free} == set(
        priors_of(setup.intrinsics, setup.cover, reference.model.path).sigmas
    )


@pytest.fixture
def guidance(made: Scene) -> Iterator[Guidance]:
    requested = Guidance(made.board, CAMERA, GLASS, REACH, target_px=20.0)
    yield requested
    requested.close()


@pytest.mark.slow
def test_the_process_starts_again_after_it_was_killed(guidance: Guidance) -> None:
    (guide,) = guidance.guides([])
    sigma = guide.progress([]).sigma_px
    assert sigma
    assert sigma > 5
    os.kill(guidance.pid, signal.SIGKILL)
    with pytest.raises(GuidanceError, match=r"has ended .* the next view starts it again"):
        list(guidance.guides([]))
    assert len(list(guidance.guides([]))) == 1
    guidance.close()
    assert list(guidance.guides([])) == []


@pytest.mark.slow
def test_a_later_question_ends_an_earlier_one(guidance: Guidance, made: Scene) -> None:
    views = [KeptView(view.corners) for view in made.views[:6]]
    earlier = guidance.guides(views)
    assert "still running" in next(earlier).progress(views).sentence
    (later,) = guidance.guides([])  # and not the earlier one's folds
    assert later.progress([]).sigma_px == pytest.approx(
        guidance_of(made, 0, 20.0)[0].progress([]).sigma_px
    )
    assert list(earlier) == []


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (20.0, ["still running", "agree"]),
        (0.01, ["would not reach"]),
    ],
)
@pytest.mark.slow
def test_folds_are_tried_once_the_maps_are_certain_enough(
    target: float, words: list[str], made: Scene
) -> None:
    views = [KeptView(view.corners) for view in made.views[:6]]
    guides = guidance_of(made, 6, target)
    assert [
        word in guide.progress(views).sentence for guide, word in zip(guides, words, strict=True)
    ] == [True] * len(words)


def guidance_of(made: Scene, count: int, target: float) -> list[InformedGuide]:
    """Return the answer of the process, computed here."""
    request = Request(
        made.board, CAMERA, GLASS, REACH, tuple(view.corners for view in made.views[:count]), target
    )
    designs = [(answer.design, answer.folds_agree) for answer in answers(request)]
    return [
        InformedGuide(made.board, CAMERA, REACH, design, folds_agree=agree, target_px=target)
        for design, agree in designs
        if design
    ]


def test_without_torch_the_plain_guide_is_named(
    tmp_path: Path, made: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "torch.py").write_text("raise ImportError('No module named torch')\n")
    monkeypatch.syspath_prepend(tmp_path)
    guidance = Guidance(made.board, CAMERA, GLASS, REACH)
    try:
        with pytest.raises(GuidanceError, match="no torch, so the plain guide serves"):
            list(guidance.guides([]))
    finally:
        guidance.close()


@pytest.mark.parametrize(
    ("camera", "cover"),
    [(Camera(3280, 2464), GLASS), (CAMERA, Cover("none", {}))],
    ids=["no intrinsics", "no cover"],
)
def test_requests_that_the_guide_cannot_serve_are_reported(
    camera: Camera, cover: Cover, made: Scene
) -> None:
    guidance = Guidance(made.board, camera, cover, REACH)
    try:
        with pytest.raises(GuidanceError, match="needs a cover and the camera's intrinsics"):
            list(guidance.guides([]))
    finally:
        guidance.close()
