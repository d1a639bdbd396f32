"""The scatter of a rig's placements about its estimate: standard deviations that count placements,
not corners (`calib.inference.view_scatter`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.effects.board_scale import BoardScale
from calib.estimation.orthogonal_projection import orthonormal_basis, subtract_projection
from calib.inference.board_bend import any_print, shifts_by_print
from calib.inference.view_scatter import MIN_VIEWS, ViewScatter, WhitenedRows
from calib.rig.joint_estimate import RigEstimate, RigState
from calib.rig.own_effects import with_effects
from calib.session.board import Board

PLACEMENTS_AT_ONCE = 8
"""The number of placements whose rows are in memory together."""

NOISE_DRAWS = 16
"""Draws of noise that show the scatter of so few placements by chance. Near placements tell far
more of the glass than others, so it is larger than that of placements that all tell alike: on ten
clean pairs behind uneven cones, the sigma of lengths was 1.26 times the error without these.
"""

Array = NDArray[np.float64]


def count_placements(estimate: RigEstimate, board: Board) -> tuple[RigEstimate, float]:
    """Return the estimate with a covariance that counts placements, and the scatter of the
    placements over that of independent corners. The covariance has the shifts by an error of the
    print, too (`calib.inference.board_bend`).
    """
    finite = bool(torch.isfinite(estimate.covariance).all())
    if len(estimate.state.placements) < MIN_VIEWS or not finite:
        return estimate, 1.0
    root = np.linalg.cholesky(estimate.covariance.numpy())
    # One camera alone is as `calib fit` has it.
    draws = NOISE_DRAWS if len(estimate.state.cameras) > 1 else 0
    scatter = ViewScatter.of_groups(_placement_rows(estimate.state, root), root, draws)
    covariance = estimate.covariance + torch.from_numpy(scatter.excess)
    if board.has_grid:
        shifts = _possible_print_shifts(estimate, board, scatter.inflation)
        covariance += torch.from_numpy(shifts)
    return replace(estimate, covariance=covariance), scatter.ratio


def _possible_print_shifts(estimate: RigEstimate, board: Board, inflation: float) -> Array:
    """Return (S, S) the covariance of the shifts of the rig's vector by an error of the print."""
    cameras = estimate.state.cameras
    if any(isinstance(e, BoardScale) for camera in cameras for e in camera.model.effects):
        return np.zeros(estimate.covariance.shape)
    effect = any_print(board)
    wide = with_effects(estimate.state, [(effect,)] * len(cameras))
    (print_errors,) = wide.effects
    entries, base = print_errors.entries, wide.base
    state = wide.state
    rows = state.problem().linearisation(state.vector(), state.placements)
    reduced = rows.equations.eliminate_blocks()
    hessian, gradient = reduced.hessian.numpy(), reduced.gradient.numpy()
    coupling = hessian[np.ix_(base, entries)]
    imitation = estimate.covariance.numpy() @ coupling
    information = hessian[np.ix_(entries, entries)] - coupling.T @ imitation
    # At the optimum, the gradient by the numbers of the rig is zero.
    score = gradient[entries]
    return shifts_by_print(effect, imitation, information / inflation**2, score / inflation**2)


def _placement_rows(state: RigState, root: Array) -> Iterator[WhitenedRows]:
    """Yield the rows of all corners of each placement, with the placement eliminated.

    Args:
        root: (S, S) root of the covariance of the rig's vector.
    """
    for first in range(0, len(state.placements), PLACEMENTS_AT_ONCE):
        chunk = state.select_placements(range(first, first + PLACEMENTS_AT_ONCE))
        rows: dict[int, list[tuple[Array, Array, Array]]] = {}
        problem = chunk.problem()
        vector = chunk.vector()
        for camera in problem.cameras:
            composed = camera.compose_with_derivatives(vector, chunk.placements)
            columns, moving = camera.columns.numpy(), camera.moving.numpy()
            slopes = camera.by_moving(composed).numpy()
            view = 0
            for piece in camera.landing.linearise(vector[camera.columns], composed.poses):
                for start, stop in zip(piece.starts[:-1], piece.starts[1:], strict=True):
                    by_pose = piece.jacobian_block[start:stop].flatten(0, 1).numpy()
                    by_camera = piece.jacobian_shared[start:stop].flatten(0, 1).numpy()
                    whitened = by_camera @ root[columns] + by_pose @ slopes[view] @ root[moving]
                    by_placement = by_pose @ composed.by_placement[view].numpy()
                    residual = piece.residual[start:stop].flatten().numpy()
                    place = int(camera.placement[view])
                    rows.setdefault(place, []).append((whitened, by_placement, residual))
                    view += 1
        for views in rows.values():
            basis = orthonormal_basis(np.concatenate([part[1] for part in views]))
            whitened = np.concatenate([part[0] for part in views])
            residual = np.concatenate([part[2] for part in views])
            yield WhitenedRows(
                subtract_projection(basis, whitened), subtract_projection(basis, residual)
            )
