"""Where on the glass the residual asks for a finer relief."""

from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

from calib.diagnosis.score_test import Optimum
from calib.effects.effect import Surroundings
from calib.estimation.objective import LandingProblem, Shared, view_precision
from calib.estimation.residual_blocks import landings, pixel_weights
from calib.optics.relief import Relief
from calib.session.board import Board
from calib.session.camera import Camera

SCAN = 3
"""Times denser than the relief: the centres among which the place is sought."""


def suspect(at: Optimum) -> Tensor | None:
    """(2,) chart coordinates of the fine centre with the largest score; None without a relief."""
    path = at.model.path
    outer = path.cover[-1] if path.cover else None
    if outer is None or outer.relief is None:
        return None
    coarse = outer.relief
    rows, columns = (SCAN * (n - 1) + 1 for n in coarse.grid)
    fine = Relief(coarse.low, coarse.high, (rows, columns))
    kept = Relief(coarse.low, coarse.high, coarse.grid, coarse.beta, "coarse")
    joint, seen = at.joint, at.observations
    finer = replace(path, cover=(*path.cover[:-1], replace(outer, relief=fine, more=(*outer.more, kept))))
    zero = torch.zeros(fine.grid, dtype=torch.float64)
    values = {**joint.values, "coarse.amplitudes": joint.values["relief.amplitudes"], "relief.amplitudes": zero}
    weights = pixel_weights(finer, values, seen, joint.poses, joint.sigma)
    shared = Shared(values, fine, {})
    problem = LandingProblem(
        shared, tuple(landings(finer, values, seen, weights, (), True)), zero.new_zeros(0, 0), view_precision(joint.poses)
    )
    scores, squares = np.zeros(rows * columns), np.zeros(rows * columns)
    for piece in problem.linearise(zero.new_zeros(shared.count), joint.poses):
        for first, last in zip(piece.starts[:-1].tolist(), piece.starts[1:].tolist(), strict=True):
            block, residual, bells = (
                p[first:last].flatten(0, 1).numpy() for p in (piece.jacobian_block, piece.residual.unsqueeze(-1), piece.jacobian_shared)
            )
            q = np.linalg.qr(block)[0]
            off, own = residual - q @ (q.T @ residual), bells - q @ (q.T @ bells)
            scores += (own.T @ off)[:, 0]
            squares += (own**2).sum(0)
    score = np.where(squares > 1e-3 * squares.max(), scores**2 / np.maximum(squares, 1e-300), 0.0)
    best = int(score.argmax())
    along = [torch.linspace(low, high, n, dtype=torch.float64) for low, high, n in zip(fine.low, fine.high, fine.grid, strict=True)]
    return torch.stack([along[0][best // columns], along[1][best % columns]])


def surroundings(at: Optimum, board: Board, camera: Camera, *, place: bool) -> Surroundings:
    """What effects may go by there; the place on the glass only if it is asked for, as it takes a while."""
    free = frozenset(at.model.free)
    return Surroundings(board, camera.width, camera.height, at.model.path, at.joint.values, free, suspect(at) if place else None)
