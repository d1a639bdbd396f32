"""The turn of the board in each view: a board without markers looks the same after half a turn, and
a square one after a quarter turn.

A detector starts at the corner that is upper left in the picture. If the board was turned between
two pictures by a quarter turn, its axes are exchanged there. The fit of a bent board then averages
two bends, and the rest looks as if the board flexed. calib.fitting.half_turns finds half turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.corners.view import View
from calib.effects.board_shape import DEGREES, BoardShape
from calib.effects.effect import scaled_prior_sigmas
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.estimation.orthogonal_projection import project_out
from calib.estimation.view_equations import view_equations
from calib.inference.fitted_model import FittedModel
from calib.session.board import Board

MIN_CHI2 = 100.0
"""The least decrease of the squares of all views, over the noise variance, that shows turned
boards: the best of all turns decreases them by a few for each view without any reason.
"""
MIN_VIEW_CHI2 = 15.0
"""The mean decrease that each turned view must have."""
MAX_ROUNDS = 20
"""Rounds of assigning turns to views and of estimating the bend."""
MAX_STARTS = 6
"""Views whose own bend is tried as the start."""
RENUMBERED = "turned boards"
"""A few words for the progress bar of the fit that follows."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _ViewBends:
    """The quadratic costs of V views as functions of the bend in each view's own frame."""

    information: Array
    """(V, k, k) of the bend's parameters, the view's pose eliminated."""
    score: Array
    """(V, k) information times the best bend of each view."""

    def costs(self, bend: Array) -> Array:
        """Return the (V,) squares over the noise variance, up to a constant."""
        return np.asarray(self.information @ bend @ bend - 2 * self.score @ bend)


def find_turned(
    model: CameraModel, observations: Observations, joint: JointFit, board: Board
) -> NDArray[np.bool_]:
    """Return (V,) true for each view in which the board is turned by a quarter turn against the
    majority of the views; all false unless the views clearly show turned boards. Half a turn
    exchanges nothing in the shape of degree 2 (`calib.fitting.half_turns`).

    Args:
        model: a model of these views with a flat board.
        observations: the views of its fit.
        joint: its fit.
        board: the board.
    """
    still = np.zeros(len(observations.names), bool)
    if board.coding or board.columns != board.rows:
        return still
    bend = BoardShape(*board.half, DEGREES[0])
    views = _view_bends(model, observations, joint, bend)
    prior = np.asarray(np.diag(scaled_prior_sigmas(bend) ** -2.0), np.float64)
    turn = _quarter_turn(bend)
    unturned = _cost(views, still, _best_bend(views, still, turn, prior), turn, prior)
    best = still
    lowest = unturned
    strongest = np.argsort(-np.trace(views.information, axis1=1, axis2=2), kind="stable")
    for start in strongest[:MAX_STARTS].tolist():
        middle = np.asarray(
            np.linalg.solve(views.information[start] + prior, views.score[start]), np.float64
        )
        assigned = still
        for _ in range(MAX_ROUNDS):
            previous = assigned
            assigned = views.costs(turn @ middle) < views.costs(middle)
            middle = _best_bend(views, assigned, turn, prior)
            if (assigned == previous).all():
                break
        if (cost := _cost(views, assigned, middle, turn, prior)) < lowest:
            lowest, best = cost, assigned
    if 2 * np.count_nonzero(best) > len(best):
        best = ~best
    is_clear = unturned - lowest > max(MIN_CHI2, MIN_VIEW_CHI2 * np.count_nonzero(best))
    return best if is_clear else still


def turn_back(view: View, board: Board, quarters: int = 1) -> View:
    """Return the view with its corners in the order of the board that is not turned by this many
    quarter turns. After one, rows become columns, and the blurs across the edges along both change
    places.
    """
    order = np.rot90(np.arange(board.count).reshape(board.rows, board.columns), quarters).ravel()
    step = -1 if quarters % 2 else 1
    return replace(
        view,
        corners=view.corners[order],
        weight=view.weight[order],
        covariance=None if view.covariance is None else view.covariance[order],
        blur=None if view.blur is None else view.blur[order][:, ::step],
    )


def describe_turned(names: Sequence[str], turn: str = "a quarter turn", verb: str = "is") -> str:
    """Return a sentence on the views whose corners were renumbered."""
    return (
        f"The board {verb} turned by {turn} in {len(names)} view{'s' * (len(names) > 1)}, and"
        f" the corners there are renumbered: {', '.join(names)}."
    )


def _view_bends(
    model: CameraModel, observations: Observations, joint: JointFit, bend: BoardShape
) -> _ViewBends:
    """Return the cost of each view around the fit, with all shared parameters but the bend held."""
    fitted = FittedModel(model, observations, joint)
    free = tuple(number.param for number in bend.effect_parameters)
    parameters = replace(fitted.parameters((bend,)), relief=None, free=free)
    equations = view_equations(
        model.with_effect(bend).path,
        parameters,
        observations,
        joint.poses,
        joint.sigma,
        fitted.weights,
    )
    reduced = [view.reduce() for view in equations]
    return _ViewBends(
        np.stack([view.information for view in reduced]),
        np.stack([-view.jacobian.T @ view.residual for view in reduced]),
    )


def _quarter_turn(bend: BoardShape) -> Array:
    """Return the (k, k) matrix that turns the parameters of a bend by a quarter turn."""
    side = torch.linspace(-1.0, 1.0, bend.degree + 2, dtype=torch.float64)
    u, v = torch.meshgrid(side, side, indexing="xy")
    heights = _heights(bend, u, v)
    return np.asarray(np.linalg.lstsq(heights, _heights(bend, -v, u), rcond=None)[0], np.float64)


def _heights(bend: BoardShape, u: Tensor, v: Tensor) -> Array:
    """Return the (n, k) heights of each of a bend's terms at places of the board, without the part
    that a pose does as well.
    """
    weights = bend.weights(bend.half_x * u.flatten(), bend.half_y * v.flatten())
    heights = torch.cat(list(weights.values()), -1).numpy()
    plane = np.column_stack([np.ones(u.numel()), u.flatten(), v.flatten()])
    return project_out(plane, heights)


def _best_bend(views: _ViewBends, turned: NDArray[np.bool_], turn: Array, prior: Array) -> Array:
    """Return the (k,) bend with the smallest cost, given which views are turned."""
    of_turned = views.information[turned].sum(0)
    information = prior + turn.T @ of_turned @ turn + views.information[~turned].sum(0)
    score = turn.T @ views.score[turned].sum(0) + views.score[~turned].sum(0)
    return np.asarray(np.linalg.solve(information, score))


def _cost(
    views: _ViewBends, turned: NDArray[np.bool_], bend: Array, turn: Array, prior: Array
) -> float:
    """Return the squares over the noise variance, given which views are turned, up to a
    constant.
    """
    costs = np.where(turned, views.costs(turn @ bend), views.costs(bend))
    return float(costs.sum() + bend @ prior @ bend)
