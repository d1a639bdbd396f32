"""Intrinsics from a joint fit with the board's poses and its bend, from a fit of a flat board."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.corners.view import View, pose_labels
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import FIRST_SIGMA, ROUNDS, JointFit, Start
from calib.estimation.observations import Observations
from calib.estimation.stated_priors import priors_of
from calib.inference.board_bend import estimate_board
from calib.intrinsics.opencv_by_rays import prior_means
from calib.optics.build import pinhole_path
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.cover import Cover
from calib.session.freeing import free_own_intrinsics
from calib.threads import single_thread

NO_COVER = Cover("none", {})


def fit_with_bend(
    intrinsics: Intrinsics, views: Sequence[View], board: Board, poses: NDArray[np.float64]
) -> Intrinsics:
    """Return the intrinsics that fit the views together with the board's bend. They stay as they
    are if the fit does not converge.

    Their standard deviations are those of independent corners: a fit behind a cover weighs them
    against the corners of its own views, which count as independent there as well.

    Args:
        intrinsics: those that fit the views best with a flat board.
        views: the views.
        board: their board.
        poses: (V, 6) T_camera_board: rotation vector (rad) and translation (m).
    """
    prior = free_own_intrinsics(intrinsics)
    path, values = pinhole_path(prior)
    model = CameraModel(path, prior_means(values), priors_of(prior, NO_COVER, path))
    observations = Observations.of(views, board)
    with single_thread():
        joint = model.fit(
            observations, torch.from_numpy(poses), Start(values, FIRST_SIGMA, None), ROUNDS
        )
        _, joint = estimate_board(model, observations, joint, board, pose_labels(views))
    return estimated_intrinsics(joint, intrinsics) if joint.finite else intrinsics


def estimated_intrinsics(joint: JointFit, intrinsics: Intrinsics) -> Intrinsics:
    """Return the intrinsics of a joint fit with standard deviations and correlations.

    Args:
        joint: a fit whose first parameters are the camera's numbers.
        intrinsics: the lens model, with a number for each parameter, and its spline.
    """
    count = 4 + len(intrinsics.distortion)
    fx, fy, cx, cy, *coefficients = list(joint.estimates().values())[:count]
    covariance = joint.covariance.numpy()[:count, :count]
    sigmas = np.sqrt(covariance.diagonal())
    correlation = covariance / np.outer(sigmas, sigmas)
    rows = tuple(tuple(row[:i].tolist()) for i, row in enumerate(correlation) if i)
    return replace(
        intrinsics,
        fx=fx,
        fy=fy,
        cx=cx,
        cy=cy,
        distortion=tuple(coefficients),
        correlations=rows,
    )
