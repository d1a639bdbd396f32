"""Fit a calibration to a session.

1. Gather the views, and what is known of camera and cover: the setup.
2. Give the unknown shape, the unknown numbers and the grid of the relief a start.
3. Fit, correct the views, and fit again (`RepeatedFit`).
4. Decide how far to trust the declared numbers (`resolve_prior_conflict`).
5. Widen the covariance by the scatter of the views (`count_views`), and cross-validate if the
   settings ask for that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calib.calibration import Calibration
from calib.calibration_content import Declared
from calib.corners.view import View, pose_labels
from calib.errors import wrong_type
from calib.estimation.joint_fit import JointFit
from calib.estimation.noise import corner_noise
from calib.estimation.observations import Observations
from calib.estimation.stated_priors import with_estimates
from calib.fit_record.outcome import (
    CrossValidation,
    FitOutcome,
    FleetPriorTest,
    JointOutcome,
    Uncertainty,
)
from calib.fit_record.request import FitRequest, Settings
from calib.fitting.cross_validation import GRID_FOLDS, choose_grid, cross_validate
from calib.fitting.fit_result import added_effects, count_views, loose_names
from calib.fitting.fleet_expectation import Expectation
from calib.fitting.inputs import FitInputs, gather_inputs
from calib.fitting.other_medium import medium_log_odds
from calib.fitting.picture_settings import describe_mixed_settings
from calib.fitting.provenance import provenance
from calib.fitting.repeated_fit import RepeatedFit, check_enough, setup_of
from calib.fitting.resolve_prior_conflict import ResolvedFit, resolve_prior_conflict
from calib.fitting.setup import Setup
from calib.fitting.shape_choice import ShapeChoice, camera_sigma, choose_shape
from calib.fitting.unknown_numbers import with_initial_values
from calib.progress import Progress, Silent, check_progress
from calib.session.numbers import unknown_names
from calib.session.parameter_names import CAMERA
from calib.session.session import Session, SessionSource
from calib.threads import single_thread

GAUGES = {
    "bare": "camera frame at the pinhole",
    "paper": (
        "camera frame at the pinhole; cover and intrinsics held as stated, or as bare/ gives them;"
        " poses as a smooth cover gives them"
    ),
    "joint": (
        "camera frame at the pinhole; cover and intrinsics near what is stated, or what bare/"
        " gives, by their tolerances; the relief's overall form free, its finer detail near zero"
        " by its prior"
    ),
}


def fit(
    session: SessionSource,
    settings: Settings = Settings(),
    progress: Progress = Silent(),
    *,
    views: Sequence[View] | None = None,
) -> Calibration:
    """Calibrate a session.

    Args:
        session: the session, or the path of its folder.
        views: the corners of the session's board, where they are found already; by default those of
            the session's files.

    Raises:
        WrongTypeError: an argument is of another type.
        InputError: a picture or corners file is damaged.
        NotEnoughDataError: too few views show the board.
        OtherBoardError: the pictures show another board, which the message names.
    """
    if not isinstance(settings, Settings):
        raise wrong_type("settings", settings, "a calib.Settings, such as Settings(folds=5)")
    check_progress(progress)
    session = Session.of(session)
    source = session if views is None else None
    inputs = gather_inputs(session, progress, views)
    expectation = Expectation.of(session, inputs)
    session_setup = expectation.with_prior if expectation else setup_of(session, inputs)
    session_setup, choice = _with_unknown_numbers(session_setup, inputs, settings, progress)
    settings, grids = _with_grid(settings, session_setup, inputs, progress)
    has_pictures = source and source.frames and not source.corners
    repeated = RepeatedFit(
        session, inputs, settings, progress, session_setup, redetects=bool(has_pictures)
    )
    repeated.run()
    views = repeated.views
    with single_thread():
        media: Mapping[str, float] | None = None
        if settings.method == "joint" and not expectation:
            media = medium_log_odds(
                repeated.session_setup, repeated.fitted, views, settings, progress
            )
        resolved, prior = _resolve(repeated, expectation)
        joint, uncertainty = _with_uncertainty(resolved, views, session)
    validation: CrossValidation | None = None
    if settings.folds:
        repeated.check_enough(settings.folds)
        validation = cross_validate(resolved.setup, views, settings, settings.folds, progress)
    outcome = FitOutcome(
        grid_held_out_px=grids,
        intrinsics_from=inputs.intrinsics_from,
        shape_log_odds=choice.log_odds if choice else None,
        shape_map_changes_px=(choice.map_changes_px or None) if choice else None,
        shape_camera_sigma=_camera_sigma(resolved, choice) or None,
        rival_lens=_rival_lens(resolved) or None,
        medium_log_odds=media,
        lens_held_out_px=inputs.lens_held_out_px,
        turned_boards=repeated.turned or None,
        half_turned_boards=repeated.half_turned or None,
        mixed_settings=describe_mixed_settings(session, repeated.picture_names),
        redetections=repeated.redetections,
        outlier_corners=repeated.outlier_corners or None,
        view_noise=repeated.noise_ratios,
        cross_validation=validation,
        fleet_prior=prior,
        uncertainty=uncertainty,
        joint=JointOutcome.of(joint) if joint else None,
    )
    request = FitRequest(settings, provenance=provenance(source))
    return _calibration(repeated, resolved, joint, request, outcome)


def _resolve(
    repeated: RepeatedFit, expectation: Expectation | None
) -> tuple[ResolvedFit, FleetPriorTest | None]:
    """Return the fit that keeps or corrects the declared numbers, as the views support; and the
    test of the fleet's prior, if the session has one.
    """
    fitted, setup = repeated.fitted, repeated.setup
    views, settings, progress = repeated.views, repeated.settings, repeated.progress
    if repeated.inputs.is_own:
        return ResolvedFit(fitted, setup, setup), None
    if expectation:
        return expectation.resolve(fitted, views, settings, progress)
    session_setup = repeated.session_setup
    return resolve_prior_conflict(fitted, setup, session_setup, views, settings, progress), None


def _with_unknown_numbers(
    setup: Setup, inputs: FitInputs, settings: Settings, progress: Progress
) -> tuple[Setup, ShapeChoice | None]:
    """Return the setup with the most probable shape of a cover whose shape is unknown, and with
    values from which its unknown numbers start; and the choice of the shape, if there was one.
    """
    choice: ShapeChoice | None = None
    if setup.cover.has_unknown_shape:
        check_enough(setup.board, inputs.views, inputs.rejected)
        choice = choose_shape(setup, inputs.views, settings, progress)
        setup = choice.setup
    if unknown_names(setup.intrinsics, setup.cover):
        check_enough(setup.board, inputs.views, inputs.rejected)
        with single_thread():
            setup = with_initial_values(setup, inputs.views, progress)
    return setup, choice


def _camera_sigma(resolved: ResolvedFit, choice: ShapeChoice | None) -> Mapping[str, float]:
    """Return the standard deviations in px of fx, fy, cx and cy over all explanations that fit the
    views about equally well; empty if there is only one.
    """
    if resolved.rival:
        return camera_sigma([resolved.fitted, resolved.rival])
    return choice.camera_sigma if choice else {}


def _rival_lens(resolved: ResolvedFit) -> dict[str, float]:
    if not resolved.rival:
        return {}
    return {name: float(resolved.rival.values[name]) for name in CAMERA.pinhole}


def _with_grid(
    settings: Settings, setup: Setup, inputs: FitInputs, progress: Progress
) -> tuple[Settings, dict[str, float]]:
    """Return the settings with a grid of the relief, chosen by held-out views where they have none;
    and the held-out error of each grid that was tried.
    """
    views, rejected = inputs.views, inputs.rejected
    if settings.folds:
        check_enough(setup.board, views, rejected, settings.folds)
    if settings.grid is not None:
        return settings, {}
    check_enough(setup.board, views, rejected, GRID_FOLDS)
    grid, grids = choose_grid(setup.with_tolerances(settings), views, settings, progress)
    return replace(settings, grid=grid), grids


def _with_uncertainty(
    resolved: ResolvedFit, views: Sequence[View], session: Session
) -> tuple[JointFit | None, Uncertainty | None]:
    """Return the joint fit with its covariance widened by the scatter of the views, and a record of
    that scatter, None without a joint fit.
    """
    fitted, setup = resolved.fitted, resolved.setup
    if not (fitted.joint and fitted.model):
        return fitted.joint, None
    observations = Observations.of(views, session.board)
    loose = loose_names(setup.intrinsics, setup.cover)
    labels = pose_labels(views)
    return count_views(
        fitted.model,
        observations,
        fitted.joint,
        labels,
        session.board,
        session.camera,
        loose,
        fitted.on_averages.observations if fitted.on_averages else None,
    )


def _calibration(
    repeated: RepeatedFit,
    resolved: ResolvedFit,
    joint: JointFit | None,
    request: FitRequest,
    outcome: FitOutcome,
) -> Calibration:
    """Return the calibration of a fit."""
    session, inputs, settings = repeated.session, repeated.inputs, repeated.settings
    fitted, setup, views = resolved.fitted, resolved.setup, repeated.views
    intrinsics, cover = with_estimates(setup.intrinsics, setup.cover, joint)
    return Calibration(
        board=session.board,
        camera=replace(session.camera, intrinsics=intrinsics),
        cover=cover,
        relief=fitted.path.settled_relief(fitted.values),
        amplitudes=(
            fitted.values["relief.amplitudes"].numpy() if fitted.relief else np.zeros((0, 0))
        ),
        exact_hit=settings.exact_hit,
        views=views,
        poses=fitted.poses.numpy(),
        covariance=joint.saved_covariance if joint else np.zeros((0, 0)),
        rejected=repeated.rejected,
        stages=fitted.stages,
        noise_px=corner_noise(fitted.residuals.image, views, session.board),
        gauge=GAUGES[settings.method if fitted.relief else "bare"],
        request=request,
        outcome=outcome,
        effects=added_effects(fitted.effects, joint) if joint else (),
        stated=Declared(
            inputs.intrinsics if inputs.is_own else resolved.declared.intrinsics,
            resolved.declared.cover,
            resolved.doubted,
        ),
    )
