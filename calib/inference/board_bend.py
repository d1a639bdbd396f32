"""The bend and the print of the board, estimated beside all other parameters wherever the views
show them.

A bent board that is taken as flat makes the lens and the cover wrong: on measured sets, sheets on a
stiff back are bent by 0.3 to 2.5 mm. The bend is the board's shape of degree 2, 3 or 4 by evidence,
with the prior `calib.session.tolerances.BOARD_SHAPE`. The print is stretched by some tenths of a
per cent, and unevenly. It is estimated without a cover only: glass can imitate it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from calib.effects.board_scale import DEGREES as PRINT_DEGREES
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import DEGREES, BoardShape
from calib.effects.effect import Effect, log_bayes_factor, scaled_prior_sigmas
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS, JointFit
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.observations import Observations
from calib.inference.cross_validation import FOLDS, fold_split, held_out_gain, hold_out
from calib.inference.fitted_model import FittedModel
from calib.inference.score_test import tuned_score_tests
from calib.session.board import Board

MIN_LOG_ODDS = math.log(100)
"""The least log Bayes factor against a flat board. A bend that is not there costs nearly nothing, a
missing one moves the principal point by many standard deviations: a hundred to one is enough.
"""
MAX_P_VALUE = 0.02
"""The largest p-value of the gain on held-out views: 5 %, where one fit asks two or three times.
Evidence alone is not enough: it counts corners as independent, which they are not where the model
lacks something else.
"""
CLEAR_RATIO = 0.95
"""Without a cover, a bend that lowers the error of the fit below this fraction needs no held-out
test, if the views agree on its score: three numbers cannot fit a twentieth of the noise of hundreds
of corners. Behind uneven glass, a board that moves during the readout did as much.
"""
AGREEMENT_P_VALUE = 0.05
"""The largest p-value of the views' agreement on the score of such a bend."""
MIN_PRINT_VIEWS = 12
"""The fewest poses of the board from which a print is estimated: it has up to 16 numbers."""
MIN_GAIN = 0.01
"""The least relative decrease of the error on held-out views."""
MAX_PRINT_P_VALUE = 0.1
"""The largest p-value of that gain for a print. It moves all corners a little, so twenty views do
not make it surer, and it moves the camera less than a bend does.
"""
MAX_SIGMAS = 3.0
"""Standard deviations of the prior beyond which a number of the bend is not one of a board: it
imitates something else.
"""


def estimate_board(
    model: CameraModel,
    observations: Observations,
    joint: JointFit,
    board: Board,
    labels: NDArray[np.int64] | None = None,
) -> tuple[CameraModel, JointFit]:
    """Return the model and its fit with the board's bend and, without a cover, with its print, each
    if the views show it.

    Args:
        model: a model of a flat and even board.
        observations: the views of its fit.
        joint: its fit.
        board: the board of the views.
        labels: (V,) labels of the board's poses, as `calib.corners.view.pose_labels` gives them;
            None if each view has a pose of its own.
    """
    if labels is None:
        labels = np.arange(len(observations.names))
    poses = len(np.unique(labels))
    if poses >= FOLDS:
        model, joint = _estimate_bend(model, observations, joint, board, labels)
    if poses >= MIN_PRINT_VIEWS and not model.path.cover:
        model, joint = _estimate_print(model, observations, joint, board, labels)
    return model, joint


def _estimate_bend(
    model: CameraModel,
    observations: Observations,
    joint: JointFit,
    board: Board,
    labels: NDArray[np.int64],
) -> tuple[CameraModel, JointFit]:
    covered = model.path.relief is not None
    # Behind a cover, held-out views cost as much as a fit: the views must agree on the score first.
    max_disagreement = MAX_P_VALUE if covered else 1.0
    trial = _trial(
        model, observations, joint, BoardShape(*board.half, DEGREES[-1]), max_disagreement
    )
    if not trial:
        return model, joint
    bent, bent_joint, p_value = trial
    is_clear = bent_joint.sigma < CLEAR_RATIO * joint.sigma and p_value < AGREEMENT_P_VALUE
    if is_clear and not covered:
        return bent, bent_joint
    extended = bent, bent_joint
    return _confirmed(observations, labels, (model, joint), extended, MAX_P_VALUE)


def _estimate_print(
    model: CameraModel,
    observations: Observations,
    joint: JointFit,
    board: Board,
    labels: NDArray[np.int64],
) -> tuple[CameraModel, JointFit]:
    effect = BoardScale(True, PRINT_DEGREES[-1], board.half)
    trial = _trial(model, observations, joint, effect)
    if not trial:
        return model, joint
    uneven, uneven_joint, _ = trial
    extended = uneven, uneven_joint
    return _confirmed(observations, labels, (model, joint), extended, MAX_PRINT_P_VALUE)


def _trial(
    model: CameraModel,
    observations: Observations,
    joint: JointFit,
    richest: Effect,
    max_disagreement: float = 1.0,
) -> tuple[CameraModel, JointFit, float] | None:
    """Return the model with the most probable form of an effect, its fit, and the p-value of the
    views' agreement on its score; None if it is not more probable, or not possible for a board.

    Args:
        richest: the form with the most parameters.
        max_disagreement: the largest p-value for which the effect is fitted.
    """
    if joint.outcome is not Outcome.CONVERGED:
        return None
    (test,) = tuned_score_tests(FittedModel(model, observations, joint), [richest])
    log_odds = log_bayes_factor(test.information, test.score, scaled_prior_sigmas(test.effect))
    if log_odds < MIN_LOG_ODDS or test.p_value > max_disagreement:
        return None
    extended = model.with_effect(test.effect)
    fit = extended.fit(observations, joint.poses, joint.start, ROUNDS)
    is_more_probable = fit.log_marginal > joint.log_marginal + MIN_LOG_ODDS
    is_usable = fit.outcome is Outcome.CONVERGED and _is_possible(fit, test.effect)
    return (extended, fit, test.p_value) if is_usable and is_more_probable else None


def _confirmed(
    observations: Observations,
    labels: NDArray[np.int64],
    simple: tuple[CameraModel, JointFit],
    extended: tuple[CameraModel, JointFit],
    max_p_value: float,
) -> tuple[CameraModel, JointFit]:
    """Return the extended model and its fit where held-out views confirm it, else the simple
    one's.
    """
    folds = fold_split(labels)
    gain = held_out_gain(
        hold_out(simple[0], observations, simple[1], folds),
        hold_out(extended[0], observations, extended[1], folds),
    )
    is_confirmed = gain.relative > MIN_GAIN and gain.p_value < max_p_value
    return extended if is_confirmed else simple


def _is_possible(joint: JointFit, effect: Effect) -> bool:
    """True if the numbers of an effect are those of a board."""
    return all(
        abs(float(joint.values[parameter.param.name])) < MAX_SIGMAS * parameter.sigma
        for parameter in effect.effect_parameters
    )
