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
MIN_PRINT_GAIN = 0.01
"""The least relative decrease of the error on held-out views for a print."""
MAX_PRINT_P_VALUE = 0.1
"""The largest p-value of that gain. A print moves all corners a little, so twenty views do not make
it surer, and it moves the camera less than a bend does.
"""
MIN_GAIN = 0.01
"""The least relative decrease of the error on held-out views."""
MAX_SIGMAS = 3.0
"""Standard deviations of the prior beyond which a number of the bend is not one of a board: it
imitates something else.
"""


def estimate_bend(
    model: CameraModel,
    observations: Observations,
    joint: JointFit,
    board: Board,
    labels: NDArray[np.int64] | None = None,
) -> tuple[CameraModel, JointFit]:
    """Return the model and its fit with the board's bend, or unchanged if the board is flat as far
    as the views show.

    Args:
        model: a model without a bend.
        observations: the views of its fit.
        joint: its fit.
        board: the board of the views.
        labels: (V,) labels of the board's poses, as `calib.corners.view.pose_labels` gives them;
            None if each view has a pose of its own.
    """
    if labels is None:
        labels = np.arange(len(observations.names))
    if joint.outcome is not Outcome.CONVERGED or len(np.unique(labels)) < FOLDS:
        return model, joint
    fitted = FittedModel(model, observations, joint)
    (test,) = tuned_score_tests(fitted, [BoardShape(*board.half, DEGREES[-1])])
    bend = test.effect
    log_odds = log_bayes_factor(test.information, test.score, scaled_prior_sigmas(bend))
    # Behind a cover, held-out views cost as much as a fit: the views must agree on the score first.
    if log_odds < MIN_LOG_ODDS or (model.path.relief and test.p_value > MAX_P_VALUE):
        return model, joint
    bent = model.with_effect(bend)
    bent_joint = bent.fit(observations, joint.poses, joint.start, ROUNDS)
    is_possible = _is_possible(bent_joint, bend)
    is_more_probable = bent_joint.log_marginal > joint.log_marginal + MIN_LOG_ODDS
    if not (bent_joint.outcome is Outcome.CONVERGED and is_possible and is_more_probable):
        return model, joint
    is_clear = bent_joint.sigma < CLEAR_RATIO * joint.sigma and test.p_value < AGREEMENT_P_VALUE
    if is_clear and not model.path.relief:
        return bent, bent_joint
    folds = fold_split(labels)
    gain = held_out_gain(
        hold_out(model, observations, joint, folds), hold_out(bent, observations, bent_joint, folds)
    )
    is_confirmed = gain.relative > MIN_GAIN and gain.p_value < MAX_P_VALUE
    return (bent, bent_joint) if is_confirmed else (model, joint)


def estimate_board(
    model: CameraModel,
    observations: Observations,
    joint: JointFit,
    board: Board,
    labels: NDArray[np.int64] | None = None,
) -> tuple[CameraModel, JointFit]:
    """Return `estimate_bend`, and without a cover also the print, if the views show one. The
    arguments are those of `estimate_bend`.
    """
    model, joint = estimate_bend(model, observations, joint, board, labels)
    if labels is None:
        labels = np.arange(len(observations.names))
    if (
        model.path.cover
        or joint.outcome is not Outcome.CONVERGED
        or len(np.unique(labels)) < MIN_PRINT_VIEWS
    ):
        return model, joint
    fitted = FittedModel(model, observations, joint)
    (test,) = tuned_score_tests(fitted, [BoardScale(True, PRINT_DEGREES[-1], board.half)])
    log_odds = log_bayes_factor(test.information, test.score, scaled_prior_sigmas(test.effect))
    if log_odds < MIN_LOG_ODDS:
        return model, joint
    uneven = model.with_effect(test.effect)
    uneven_joint = uneven.fit(observations, joint.poses, joint.start, ROUNDS)
    is_more_probable = uneven_joint.log_marginal > joint.log_marginal + MIN_LOG_ODDS
    if not (
        uneven_joint.outcome is Outcome.CONVERGED
        and is_more_probable
        and _is_possible(uneven_joint, test.effect)
    ):
        return model, joint
    folds = fold_split(labels)
    gain = held_out_gain(
        hold_out(model, observations, joint, folds),
        hold_out(uneven, observations, uneven_joint, folds),
    )
    is_confirmed = gain.relative > MIN_PRINT_GAIN and gain.p_value < MAX_PRINT_P_VALUE
    return (uneven, uneven_joint) if is_confirmed else (model, joint)


def _is_possible(joint: JointFit, effect: Effect) -> bool:
    """True if the numbers of an effect are those of a board."""
    return all(
        abs(float(joint.values[parameter.param.name])) < MAX_SIGMAS * parameter.sigma
        for parameter in effect.effect_parameters
    )
