"""Fit a calibration to a session."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from calib.calibration import Calibration
from calib.calibration_content import Declared
from calib.corners.detect_all import refuse_larger_board
from calib.corners.view import MISFIT, RejectedPicture, View, describe_most, pose_labels
from calib.errors import NotEnoughDataError, wrong_type
from calib.estimation.noise import corner_noise
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals
from calib.estimation.robust import outlier_mask
from calib.estimation.stated_priors import with_estimates
from calib.fit_record.outcome import (
    FitOutcome,
    FleetPriorTest,
    JointOutcome,
    Redetection,
    Uncertainty,
)
from calib.fit_record.request import FitRequest, Settings
from calib.fitting.board_turns import RENUMBERED, turn_back
from calib.fitting.cross_validation import GRID_FOLDS, choose_grid, cross_validate
from calib.fitting.fit_result import added_effects, count_views, loose_names
from calib.fitting.fleet_expectation import Expectation
from calib.fitting.guided_redetection import redetect_corners
from calib.fitting.half_turns import HalfTurned
from calib.fitting.inputs import FitInputs, gather_inputs, recalibrate_bare
from calib.fitting.other_medium import medium_log_odds
from calib.fitting.picture_settings import describe_mixed_settings
from calib.fitting.provenance import provenance
from calib.fitting.resolve_prior_conflict import ResolvedFit, resolve_prior_conflict
from calib.fitting.shape_choice import ShapeChoice, choose_shape
from calib.fitting.stages import Fitted, Setup, fit_stages
from calib.fitting.unknown_numbers import with_initial_values
from calib.fitting.view_noise import weigh_noisy_views
from calib.progress import Progress, Silent, check_progress
from calib.session.board import Board
from calib.session.numbers import unknown_names
from calib.session.session import MIN_FIT_VIEWS, Session, SessionSource
from calib.threads import single_thread

LARGE_ERROR = 1.0
"""px, root mean square: with a larger error, the corners may be those of a part of the board, which
is another one in each picture.
"""
GAUGES = {
    "bare": "camera frame at the pinhole",
    "paper": (
        "camera frame at the pinhole; cover and intrinsics held as stated, or as bare/ gives them;"
        " poses as a smooth cover gives them"
    ),
    "joint": (
        "camera frame at the pinhole; cover and intrinsics near what is stated, or what bare/"
        " gives, by their tolerances; the relief's figure free, what is finer near zero by its"
        " prior"
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
    start = gather_inputs(session, progress, views)
    views, rejected = start.views, start.rejected
    expectation = Expectation.of(session, start)
    nominal = expectation.nominal if expectation else _nominal_setup(session, start)
    choice: ShapeChoice | None = None
    if nominal.cover.has_unknown_shape:
        _check_enough(session.board, views, rejected)
        choice = choose_shape(nominal, views, settings, progress)
        nominal = choice.setup
    if unknown_names(nominal.intrinsics, nominal.cover):
        _check_enough(session.board, views, rejected)
        with single_thread():
            nominal = with_initial_values(nominal, views, progress)
    setup = nominal.with_tolerances(settings)
    grids: dict[str, float] = {}
    if settings.folds:
        _check_enough(session.board, views, rejected, for_folds=settings.folds)
    if settings.grid is None:
        _check_enough(session.board, views, rejected, for_folds=GRID_FOLDS)
        grid, grids = choose_grid(setup, views, settings, progress)
        settings = replace(settings, grid=grid)
    has_pictures = source and source.frames and not source.corners
    redetections: tuple[Redetection, ...] | None = None if has_pictures else ()
    earlier: Fitted | None = None
    decided: Fitted | None = None
    turned: tuple[str, ...] = ()
    half_turned: tuple[str, ...] = ()
    is_half_turn_tried = False
    purpose = ""
    while True:
        _check_enough(session.board, views, rejected)
        observations = Observations.of(views, session.board)
        with single_thread():
            fitted = fit_stages(
                setup,
                observations,
                settings,
                progress,
                earlier=earlier,
                labels=pose_labels(views),
                decided=decided,
                purpose=purpose,
            )
        if redetections is None and not purpose and fitted.stages[-1].rms_px > LARGE_ERROR:
            names = {view.name for view in views}
            fitted_frames = [frame for frame in session.frames if frame.name in names]
            refuse_larger_board(fitted_frames, session.board)
        earlier = None
        # A flat board is questioned again with more corners.
        decided = fitted if fitted.effects else None
        if fitted.turned and not turned:
            turned = fitted.turned
            views = tuple(turn_back(v, session.board) if v.name in turned else v for v in views)
            decided = None
            purpose = RENUMBERED
            continue
        if not is_half_turn_tried:
            is_half_turn_tried = True
            with single_thread():
                half_turns = HalfTurned.find(fitted, views, setup, settings, progress)
            if half_turns:
                half_turned, views, fitted = half_turns.names, half_turns.views, half_turns.fitted
                observations = Observations.of(views, session.board)
                decided = fitted if fitted.effects else None
        views, outliers = _without_outliers(views, observations, fitted.residuals)
        rejected = (*rejected, *outliers)
        if outliers:
            decided = None
            purpose = f"{len(rejected)} view{'s' * (len(rejected) > 1)} fewer"
            continue
        if redetections is not None:
            break
        with single_thread():
            size = session.camera.width, session.camera.height
            views, redetections = redetect_corners(
                fitted, views, session.board, session.frames, size, progress
            )
        if not any(redetection.new_corners for redetection in redetections):
            break
        purpose = "more corners"
        if start.intrinsics_from == "views":
            bare = recalibrate_bare(views, session, start.intrinsics, progress)
            views = bare.views
            rejected = (*rejected, *bare.rejected)
            start = replace(start, intrinsics=bare.intrinsics, intrinsics_are_final=bare.final)
            nominal = _nominal_setup(session, start)
            setup = nominal.with_tolerances(settings)
        else:
            earlier = fitted
    prior: FleetPriorTest | None = None
    media: Mapping[str, float] | None = None
    with single_thread():
        noise_ratios: dict[str, float] = {}
        if settings.method == "joint":  # the paper's method weights all views equally
            views, noise_ratios = weigh_noisy_views(
                views, observations, fitted.residuals, session.board
            )
        if noise_ratios:
            observations = Observations.of(views, session.board)
            fitted = fit_stages(
                setup,
                observations,
                settings,
                progress,
                earlier=fitted,
                decided=fitted,
                purpose="noisy views",
            )
        if settings.method == "joint" and not expectation:
            media = medium_log_odds(nominal, fitted, views, settings, progress)
        if start.is_own:
            resolved = ResolvedFit(fitted, setup, setup)
        elif expectation:
            resolved, prior = expectation.resolve(fitted, views, settings, progress)
        else:
            resolved = resolve_prior_conflict(fitted, setup, nominal, views, settings, progress)
    fitted, setup = resolved.fitted, resolved.setup
    misfits = [picture.name for picture in rejected if picture.is_misfit]
    pictures = [*(view.name for view in views), *misfits]
    joint = fitted.joint
    uncertainty: Uncertainty | None = None
    if joint and fitted.model:
        with single_thread():
            observations = Observations.of(views, session.board)
            loose = loose_names(setup.intrinsics, setup.cover)
            labels = pose_labels(views)
            joint, uncertainty = count_views(
                fitted.model, observations, joint, labels, session.board, session.camera, loose
            )
    intrinsics, cover = with_estimates(setup.intrinsics, setup.cover, joint)
    validation = None
    if settings.folds:
        _check_enough(session.board, views, rejected, for_folds=settings.folds)
        validation = cross_validate(setup, views, settings, settings.folds, progress)
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
        rejected=rejected,
        stages=fitted.stages,
        noise_px=corner_noise(fitted.residuals.image, views, session.board),
        gauge=GAUGES[settings.method if fitted.relief else "bare"],
        request=FitRequest(settings, provenance=provenance(source)),
        outcome=FitOutcome(
            grid_held_out_px=grids,
            intrinsics_from=start.intrinsics_from,
            shape_log_odds=choice.log_odds if choice else None,
            shape_map_changes_px=(choice.map_changes_px or None) if choice else None,
            shape_camera_sigma=(choice.camera_sigma or None) if choice else None,
            medium_log_odds=media,
            lens_held_out_px=start.lens_held_out_px,
            turned_boards=turned or None,
            half_turned_boards=half_turned or None,
            mixed_settings=describe_mixed_settings(session, pictures),
            redetections=redetections,
            view_noise=noise_ratios,
            cross_validation=validation,
            fleet_prior=prior,
            uncertainty=uncertainty,
            joint=JointOutcome.of(joint) if joint else None,
        ),
        effects=added_effects(fitted.effects, joint) if joint else (),
        stated=Declared(
            start.intrinsics if start.is_own else resolved.declared.intrinsics,
            resolved.declared.cover,
            resolved.doubted,
        ),
    )


def _nominal_setup(session: Session, inputs: FitInputs) -> Setup:
    return Setup(
        session.board,
        session.camera,
        inputs.prior_intrinsics,
        session.cover,
        inputs.intrinsics_are_final,
    )


def _without_outliers(
    views: Sequence[View], observations: Observations, residual: Residuals
) -> tuple[tuple[View, ...], tuple[RejectedPicture, ...]]:
    errors = residual.view_errors(observations)
    outlying = outlier_mask(errors)
    reasons = (
        (
            f"its {error:.2g} {MISFIT} {np.nanmedian(errors):.2g} px of the other views"
            if np.isfinite(error)
            else "no board pose explains its corners"
        )
        for error in errors
    )
    rejected = tuple(
        RejectedPicture(view.name, reason)
        for view, reason, is_outlier in zip(views, reasons, outlying, strict=True)
        if is_outlier
    )
    inliers = tuple(
        view for view, is_outlier in zip(views, outlying, strict=True) if not is_outlier
    )
    return inliers, rejected


def _check_enough(
    board: Board, views: Sequence[View], rejected: Sequence[RejectedPicture], for_folds: int = 0
) -> None:
    if len(views) < MIN_FIT_VIEWS:
        raise NotEnoughDataError(
            f"A fit needs {MIN_FIT_VIEWS} usable views and there are"
            f" {len(views)}{describe_most(rejected)}: take more {board.views_words}."
        )
    if not for_folds:
        return
    poses = pose_labels(views)
    fitted_count = min(
        int(np.count_nonzero(poses % for_folds != fold)) for fold in range(for_folds)
    )
    if fitted_count < MIN_FIT_VIEWS or poses.max() + 1 < for_folds:
        raise NotEnoughDataError(
            f"{for_folds} folds need as many poses of the board, and {MIN_FIT_VIEWS} usable views"
            f" outside each fold; there are {len(views)} views of {poses.max() + 1} poses in all:"
            f" take more {board.views_words}, or ask for fewer folds."
        )
