"""The context from which effects are proposed, and the place of a possible finer relief."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from calib.effects.effect import EffectContext
from calib.estimation.parameters import Parameters
from calib.estimation.priors import NONE
from calib.estimation.view_equations import view_equations
from calib.inference.fitted_model import FittedModel
from calib.optics.relief import AMPLITUDES, Relief
from calib.session.board import Board
from calib.session.camera import Camera

SCAN_DENSITY = 5
"""Candidate places of a finer relief for each centre of the relief, along each axis."""


def fine_relief_place(fitted: FittedModel) -> Tensor | None:
    """Return the (2,) chart coordinates of the finer centre with the largest score; None without a
    relief.
    """
    path = fitted.model.path
    outer = path.cover[-1] if path.cover else None
    if outer is None or outer.relief is None:
        return None
    joint = fitted.joint
    coarse = path.settled_relief(joint.values)
    assert coarse
    rows = SCAN_DENSITY * (coarse.grid[0] - 1) + 1
    columns = SCAN_DENSITY * (coarse.grid[1] - 1) + 1
    fine = Relief(coarse.low, coarse.high, (rows, columns))
    fixed = Relief(coarse.low, coarse.high, coarse.grid, coarse.beta, "coarse")
    interface = replace(outer, relief=fine, extra_reliefs=(*outer.extra_reliefs, fixed))
    fine_path = replace(path, cover=(*path.cover[:-1], interface))
    zero = torch.zeros(fine.grid, dtype=torch.float64)
    values = {**joint.values, "coarse.amplitudes": joint.values[AMPLITUDES], AMPLITUDES: zero}
    parameters = Parameters(values, fine, (), NONE)
    scores = np.zeros(rows * columns)
    squares = np.zeros(rows * columns)
    for view in view_equations(
        fine_path, parameters, fitted.observations, joint.poses, joint.sigma
    ):
        reduced = view.reduce()
        scores += reduced.jacobian.T @ reduced.residual
        squares += (reduced.jacobian**2).sum(0)
    visible = squares > 1e-3 * squares.max()
    chi2 = np.where(visible, scores**2 / np.maximum(squares, 1e-300), 0.0)
    row, column = divmod(int(chi2.argmax()), columns)
    first = torch.linspace(fine.low[0], fine.high[0], rows, dtype=torch.float64)
    second = torch.linspace(fine.low[1], fine.high[1], columns, dtype=torch.float64)
    return torch.stack([first[row], second[column]])


def effect_context(
    fitted: FittedModel, board: Board, camera: Camera, *, locate: bool
) -> EffectContext:
    """Return the context of a fit for proposing effects; with `locate`, it includes the place of a
    finer relief, which takes a while.
    """
    return EffectContext(
        board,
        camera.width,
        camera.height,
        fitted.model.path,
        fitted.joint.values,
        frozenset(fitted.model.priors.sigmas),
        camera.shutter,
        fine_relief_place(fitted) if locate else None,
    )
