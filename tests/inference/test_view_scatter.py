"""Standard deviations that count views: they hold where each view has an error of its own, and stay
as they are where the model is exact.
"""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from calib.corners.view import View, pose_labels
from calib.effects.focal import Focal
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.inference.calibration_model import full_model
from calib.inference.fitted_model import FittedModel
from calib.inference.view_scatter import MIN_VIEWS, ViewScatter
from calib.session.board import Board
from calib.session.session import Session
from tests.fitting.test_board_bend import CAMERA, LENS, SIZE, bent, pictures, session

Points = NDArray[np.float64]
BOARD = Board(9, 6, 0.025)
NOISE = 0.05
VIEWS = 16


def breathing(seed: int, spread: float, board: Points | None = None) -> tuple[View, ...]:
    """Return views whose focal length differs from view to view by a fraction `spread`, of a flat
    board or of (K, 3) m points.
    """
    rng = np.random.default_rng(seed)
    points = bent(BOARD, (0.0, 0.0, 0.0)) if board is None else board
    views: list[View] = []
    while len(views) < VIEWS:
        depth = rng.uniform(0.3, 0.8)
        place = np.array([rng.uniform(-0.3, 0.3) * depth, rng.uniform(-0.2, 0.2) * depth, depth])
        turn = np.append(np.radians(rng.uniform(-35, 35, 2)), np.radians(rng.uniform(-10, 10)))
        camera = CAMERA.copy()
        camera[[0, 1], [0, 1]] *= 1 + rng.normal(0, spread)
        corners = cv2.projectPoints(points, turn, place, camera, LENS)[0].reshape(-1, 2)
        if (corners < 5).any() or (corners > np.array(SIZE) - 5).any():
            continue
        noisy = corners + rng.normal(0, NOISE, corners.shape)
        views.append(View(f"{len(views):02d}.png", noisy, np.ones(BOARD.count)))
    return tuple(views)


def stated(made: Session) -> Session:
    """Return the session with four coefficients, so that no lens has to be chosen."""
    return replace(made, camera=replace(made.camera, lens="opencv", lens_coefficients=4))


def fitted(made: Session) -> FittedModel:
    calibration = fit(stated(made), Settings(flat_board=True))
    model = full_model(calibration)
    observations = calibration.observations
    joint = model.fit(observations, torch.from_numpy(calibration.poses))
    return FittedModel(model, observations, joint)


def labels(optimum: FittedModel) -> np.ndarray:
    return np.arange(len(optimum.observations.names))


def test_an_exact_model_scatters_as_noise_does(tmp_path: Path) -> None:
    """Six sessions of 16 views: the root mean square of so many scores is right to a quarter."""
    scatters = []
    for seed in range(6):
        made = session(tmp_path / f"{seed}", BOARD, pictures(BOARD, (0, 0, 0), VIEWS, seed=seed))
        optimum = fitted(made)
        scatters.append(ViewScatter.of(optimum, labels(optimum)).ratio)
    print(scatters)
    assert max(scatters) < 1.5
    assert 0.8 < np.median(scatters) < 1.2


@pytest.mark.slow
def test_the_focal_length_holds_where_views_differ(tmp_path: Path) -> None:
    """A focal length that is another by 0.5 % in each view. Of 12 sessions, its error is 1 of the
    standard deviations by views, within what chance leaves, and several of those by corners.
    """
    by_corners, by_views = [], []
    for seed in range(12):
        made = session(tmp_path / f"{seed}", BOARD, breathing(seed, 0.005))
        optimum = fitted(made)
        scatter = ViewScatter.of(optimum, labels(optimum))
        assert isinstance(optimum.joint, JointFit)
        wider = scatter.widen(optimum.joint)
        error = float(optimum.joint.values["camera.fx"]) - CAMERA[0, 0]
        by_corners.append(error / float(optimum.joint.sigma_of("camera.fx")))
        by_views.append(error / float(wider.sigma_of("camera.fx")))
    corners = np.sqrt(np.mean(np.square(by_corners)))
    views = np.sqrt(np.mean(np.square(by_views)))
    print(f"rms z of fx: {corners:.2f} by corners, {views:.2f} by views")
    assert corners > 2.5
    assert 0.5 < views < 1.6  # a chi of 12


def test_a_number_that_only_its_prior_holds_keeps_it(tmp_path: Path) -> None:
    """The focal effect shifts fx and fy, which the fit estimates already: only the prior tells the
    two apart.
    """
    optimum = fitted(session(tmp_path / "fit", BOARD, breathing(0, 0.005)))
    effect = Focal()
    model = optimum.model.with_effect(effect)
    joint = model.fit(optimum.observations, optimum.joint.poses, optimum.joint.start)
    extended = FittedModel(model, optimum.observations, joint)
    wider = ViewScatter.of(extended, labels(optimum)).widen(joint)
    (unknown,) = effect.effect_parameters
    assert float(wider.sigma_of(unknown.param.name)) <= 1.01 * unknown.sigma
    assert float(wider.sigma_of("camera.cx")) > 1.5 * float(joint.sigma_of("camera.cx"))


def test_pictures_of_one_pose_count_once(tmp_path: Path) -> None:
    """Each view four times: as views of their own they scatter less than they do as bursts."""
    views = breathing(1, 0.005)
    bursts = tuple(
        replace(view, name=f"{copy}-{view.name}", pose_id=view.name)
        for view in views
        for copy in range(4)
    )
    made = fitted(session(tmp_path / "fit", BOARD, views))
    observations = Observations.of(bursts, BOARD)
    model: CameraModel = made.model
    joint = model.fit(observations, made.joint.poses.repeat_interleave(4, 0), made.joint.start)
    optimum = FittedModel(model, observations, joint)
    once = ViewScatter.of(optimum, pose_labels(bursts)).ratio
    apart = ViewScatter.of(optimum, labels(optimum)).ratio
    assert once > 1.8 * apart  # four times the variance, and more leverage


def test_few_views_show_no_scatter(tmp_path: Path) -> None:
    optimum = fitted(session(tmp_path / "fit", BOARD, breathing(2, 0.005)))
    scatter = ViewScatter.of(optimum, np.arange(VIEWS) % (MIN_VIEWS - 1))
    assert scatter.ratio == 1.0
    assert not scatter.excess.any()


@pytest.mark.slow
def test_the_principal_point_holds_where_the_print_is_uneven(tmp_path: Path) -> None:
    """A print whose corners are off by 0.05 mm each, the same in all views. Of 12 sessions, the
    error of cx and cy is 1 of the standard deviations, within what chance leaves; a focal length
    that no print shifts is not far below.
    """
    print_m = 5e-5
    errors = []
    for seed in range(12):
        points = bent(BOARD, (0.0, 0.0, 0.0))
        points[:, :2] += np.random.default_rng(seed).normal(0, print_m, (BOARD.count, 2))
        optimum = fitted(session(tmp_path / f"{seed}", BOARD, breathing(seed, 0.0, points)))
        scatter = ViewScatter.of(optimum, labels(optimum))
        assert isinstance(optimum.joint, JointFit)
        assert scatter.corner_ratio > 1.5 > scatter.ratio
        wider = scatter.widen(optimum.joint)
        for name, place in (("camera.cx", (0, 2)), ("camera.cy", (1, 2))):
            error = float(optimum.joint.values[name]) - CAMERA[place]
            sigmas = [float(joint.sigma_of(name)) for joint in (optimum.joint, wider)]
            errors.append([error / sigma for sigma in sigmas])
    independent, both = np.sqrt(np.mean(np.square(errors), 0))
    print(f"rms z of cx, cy: {independent:.2f} by independent corners, {both:.2f} by both")
    assert independent > 1.8
    assert 0.6 < both < 1.4  # a chi of 24


def test_the_views_shares_are_of_all_that_they_tell(tmp_path: Path) -> None:
    """Of 16 views, one that weighs ten times as much as the others tells most."""
    views = breathing(3, 0.0)
    optimum = fitted(session(tmp_path / "even", BOARD, views))
    shares = ViewScatter.of(optimum, labels(optimum)).shares
    assert shares.sum() == pytest.approx(1)
    assert shares.max() < 0.2
    light = [replace(view, weight=np.full(BOARD.count, 0.3)) for view in views[1:]]
    calibration = fit(stated(session(tmp_path / "heavy", BOARD, (views[0], *light))))
    assert calibration.outcome.uncertainty
    heavy = calibration.outcome.uncertainty.heavy_views
    assert max(heavy, key=heavy.__getitem__) == views[0].name
