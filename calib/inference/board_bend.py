"""The bend and the print of the board, estimated beside all other parameters wherever the views
show them.

A bent board that is taken as flat makes the lens and the cover wrong: on measured sets, sheets on a
stiff back are bent by 0.3 to 2.5 mm. The bend is the board's shape of degree 2, 3 or 4 by evidence,
with the prior `calib.session.tolerances.BOARD_SHAPE`. The print is stretched by some tenths of a
per cent, and unevenly. It is estimated without a cover only: glass can imitate it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.effects.board_scale import DEGREES as PRINT_DEGREES
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import DEGREES, BoardShape
from calib.effects.effect import Effect, log_bayes_factor, scaled_prior_sigmas
from calib.effects.focal import Focal
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import ROUNDS, JointFit
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.observations import Observations
from calib.estimation.view_equations import ReducedView
from calib.inference.fitted_model import FittedModel
from calib.inference.score_test import ScoreTest, score_tests
from calib.inference.variation_equations import SPREADS
from calib.inference.view_scatter import ViewScatter
from calib.session.board import Board
from calib.session.parameter_names import CAMERA

MIN_LOG_ODDS = math.log(10)
"""The least log Bayes factor against a flat and even board, counting views. A bend that is not
there costs nearly nothing, a missing one moves the principal point by many standard deviations, and
few boards are flat: ten to one is enough.
"""
MIN_COVERED_LOG_ODDS = math.log(100)
"""The same behind a cover: glass and its numbers can imitate a bend."""
MIN_BEND_VIEWS = 5
"""The fewest poses of the board from which a bend is estimated."""
MIN_PRINT_VIEWS = 12
"""The fewest poses of the board from which a print is estimated: it has up to 16 numbers."""
SPREAD_COST = 0.5
"""The log evidence that the best spread has to gain: five of six even prints gain less, as half of
them gain nothing, and the others half of a chi² of one degree of freedom.
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
    if the views show it. A target that is not flat has neither.

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
    poses = len(np.unique(labels)) if board.is_flat else 0
    if poses >= MIN_BEND_VIEWS:
        bend = BoardShape(*board.half, DEGREES[-1])
        model, joint = _with_effect(model, observations, joint, bend, labels)
    if poses >= MIN_PRINT_VIEWS and not model.path.cover:
        print_errors = BoardScale(True, PRINT_DEGREES[-1], board.half)
        model, joint = _with_effect(model, observations, joint, print_errors, labels)
    return model, joint


def possible_prints(fitted: FittedModel, board: Board) -> tuple[BoardScale, ...]:
    """Return the error of the print that the model may lack; none if it has one, or of points."""
    has_print = any(isinstance(effect, BoardScale) for effect in fitted.model.effects)
    return (any_print(board),) if board.has_grid and not has_print else ()


def possible_print_shifts(
    fitted: FittedModel, board: Board, inflation: float, views: Sequence[ReducedView]
) -> NDArray[np.float64]:
    """Return (S, S) the covariance of the shifts of the fitted parameters by an error of the print
    that the model lacks, over their scales.

    All views share a stretched or uneven print, so their scatter does not show it. Its numbers of
    degree 1, and those of higher degrees, are normal with a spread in their tolerances, which
    maximises the evidence. A print is as likely to have such errors as to have none: the shift's
    second moment counts with the probability that it has. It is zero if the model has an error of
    the print.

    Args:
        inflation: the factor of the standard deviations of corners that are not independent.
        views: the reduced equations of the model with `possible_prints`.
    """
    count = fitted.parameters().count
    prints = possible_prints(fitted, board)
    if not prints:
        return np.zeros((count, count))
    (effect,) = prints
    products = np.zeros(0)
    for view in views:
        rows = np.column_stack((view.jacobian, view.residual))
        products = products + rows.T @ rows if products.size else rows.T @ rows
    precision = fitted.prior_precision()
    entries = fitted.parameters((effect,)).entries(u.param.name for u in effect.effect_parameters)
    coupling = products[:count, entries]
    imitation = np.asarray(np.linalg.solve(products[:count, :count] + precision, coupling))
    gradient = products[:count, -1] + precision @ fitted.deviation
    information = products[np.ix_(entries, entries)] - coupling.T @ imitation
    score = np.asarray(products[entries, -1] - imitation.T @ gradient)
    return shifts_by_print(effect, imitation, information / inflation**2, score / inflation**2)


def any_print(board: Board) -> BoardScale:
    """Return the error of a print with the most numbers."""
    return BoardScale(True, PRINT_DEGREES[-1], board.half)


def shifts_by_print(
    effect: BoardScale,
    imitation: NDArray[np.float64],
    information: NDArray[np.float64],
    score: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return (S, S) the covariance of the shifts of S parameters by an error of the print, as
    `possible_print_shifts` has it.

    Args:
        effect: of `any_print`; it has k numbers.
        imitation: (S, k) the changes of the parameters that imitate each number.
        information: (k, k), as in `Effect.tune`.
        score: (k,), as in `Effect.tune`.
    """
    sigmas = scaled_prior_sigmas(effect)
    linear = len(BoardScale(True).effect_parameters)
    moments = np.zeros((len(imitation), len(imitation)))
    for numbers in (slice(linear), slice(linear, None)):
        moment = _second_moment(information[numbers, numbers], score[numbers], sigmas[numbers])
        moments += imitation[:, numbers] @ moment @ imitation[:, numbers].T
    return moments


def _second_moment(
    information: NDArray[np.float64], score: NDArray[np.float64], sigmas: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the (k, k) second moment of numbers of a print, over their scales; zero if the corners
    show none.

    Args:
        information: (k, k), as in `Effect.tune`.
        score: (k,), as in `Effect.tune`.
        sigmas: (k,) tolerances of the numbers, over their scales.
    """
    gains = [log_bayes_factor(information, score, spread * sigmas) for spread in SPREADS]
    best = int(np.argmax(gains))
    if (gain := gains[best] - SPREAD_COST) <= 0.0:
        return np.zeros_like(information)
    covariance = np.linalg.inv(information + np.diag((SPREADS[best] * sigmas) ** -2.0))
    mean = covariance @ score
    probability = 1 / (1 + math.exp(-gain))
    return np.asarray(probability * (np.outer(mean, mean) + covariance))


def _with_effect(
    model: CameraModel,
    observations: Observations,
    joint: JointFit,
    richest: Effect,
    labels: NDArray[np.int64],
) -> tuple[CameraModel, JointFit]:
    """Return the model with the most probable form of an effect, and its fit; the same model and
    fit if the views do not show it, or show what is not possible for a board.

    The evidence counts corners as independent. It is divided by the variance that views and corners
    of the board have over that of independent corners: R. E. Chandler, S. Bate, Inference for
    clustered data using the independence loglikelihood (2007), with one factor for all directions.

    Where the focal length is held, a wrong one must explain less.

    Args:
        richest: the form with the most parameters.
    """
    if joint.outcome is not Outcome.CONVERGED:
        return model, joint
    min_log_odds = MIN_COVERED_LOG_ODDS if model.path.cover else MIN_LOG_ODDS
    is_held = CAMERA.fx not in {param.name for param in joint.parameters.free}
    rivals = [Focal()] if is_held else []
    test, *rival_tests = score_tests(FittedModel(model, observations, joint), [richest, *rivals])
    effect = richest.tune(test.information, test.score)
    log_odds = _log_odds(test, effect)
    if log_odds < max([min_log_odds, *(_log_odds(rival, rival.effect) for rival in rival_tests)]):
        return model, joint
    extended = model.with_effect(effect)
    fit = extended.fit(observations, joint.poses, joint.start, ROUNDS)
    if fit.outcome is not Outcome.CONVERGED or not _is_possible(fit, effect):
        return model, joint
    scatter = ViewScatter.of(FittedModel(extended, observations, fit), labels)
    log_odds = (fit.log_marginal - joint.log_marginal) / scatter.inflation**2
    return (extended, fit) if log_odds > min_log_odds else (model, joint)


def _log_odds(test: ScoreTest, form: Effect) -> float:
    """Return the log Bayes factor of a form of the tested effect, whose parameters begin with those
    of the form (`select_form`).
    """
    spread = scaled_prior_sigmas(form)
    count = len(spread)
    return log_bayes_factor(test.information[:count, :count], test.score[:count], spread)


def _is_possible(joint: JointFit, effect: Effect) -> bool:
    """True if the numbers of an effect are those of a board."""
    return all(
        abs(float(joint.values[parameter.param.name])) < MAX_SIGMAS * parameter.sigma
        for parameter in effect.effect_parameters
    )
