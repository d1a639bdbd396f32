"""Where on the glass the residual asks for a finer relief."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from calib.diagnosis.score_test import Optimum
from calib.effects.effect import EffectContext
from calib.estimation.elimination import project_out, view_equations
from calib.estimation.parameters import Parameters
from calib.estimation.priors import NONE
from calib.optics.relief import AMPLITUDES, Relief
from calib.session.board import Board
from calib.session.camera import Camera

SCAN = 3
"""Times denser than the relief: the centres among which the place is sought."""


def suspected_place(at: Optimum) -> Tensor | None:
    """(2,) chart coordinates of the fine centre with the largest score; None without a relief."""
    path = at.model.path
    outer = path.cover[-1] if path.cover else None
    if outer is None or outer.relief is None:
        return None
    coarse = outer.relief
    rows, columns = (SCAN * (n - 1) + 1 for n in coarse.grid)
    fine = Relief(coarse.low, coarse.high, (rows, columns))
    kept = Relief(coarse.low, coarse.high, coarse.grid, coarse.beta, "coarse")
    joint = at.joint
    finer = replace(
        path,
        cover=(
            *path.cover[:-1],
            replace(outer, relief=fine, extra_reliefs=(*outer.extra_reliefs, kept)),
        ),
    )
    zero = torch.zeros(fine.grid, dtype=torch.float64)
    values = {**joint.values, "coarse.amplitudes": joint.values[AMPLITUDES], AMPLITUDES: zero}
    scores, squares = np.zeros(rows * columns), np.zeros(rows * columns)
    for view in view_equations(
        finer, Parameters(values, fine, (), NONE), at.observations, joint.poses, joint.sigma
    ):
        bells = project_out(view.jacobian_block, view.jacobian_shared)
        scores += bells.T @ view.residual
        squares += (bells**2).sum(0)
    score = np.where(squares > 1e-3 * squares.max(), scores**2 / np.maximum(squares, 1e-300), 0.0)
    best = int(score.argmax())
    along = [
        torch.linspace(low, high, n, dtype=torch.float64)
        for low, high, n in zip(fine.low, fine.high, fine.grid, strict=True)
    ]
    return torch.stack([along[0][best // columns], along[1][best % columns]])


def surroundings(at: Optimum, board: Board, camera: Camera, *, place: bool) -> EffectContext:
    """What effects may go by there; the place on the glass only if it is asked for, as it takes a
    while.
    """
    free = frozenset(at.model.priors.sigmas)
    found = suspected_place(at) if place else None
    return EffectContext(
        board,
        camera.width,
        camera.height,
        at.model.path,
        at.joint.values,
        free,
        camera.shutter,
        found,
    )
