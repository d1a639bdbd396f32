"""The joint fit of a rig with an effect whose numbers all placements share."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.rig.board_motion import motion_in_placement
from calib.rig.explanation_fit import FittedExplanation, late_motion
from calib.rig.gauge import mounting_motion
from calib.rig.joint_estimate import RigState, estimate_rig
from calib.rig.motion_evidence import (
    FixedEstimate,
    FixedMotion,
    RandomMotion,
    ReducedMotions,
    realign,
)
from calib.rig.pose_terms import PoseTerms
from calib.rig.rig import Rig
from calib.rig.rig_context import RigContext, rig_context, roots

ROUNDS = (1e-5,)
"""The tolerance of the fit: its start is the optimum without the effect."""
REFITS = 2
"""The number of fits with a lateness, each with the path of the board from the one before."""
SETTLING = 2
"""The number of steps of the placements after one of the rig's numbers."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class JointNumbers:
    """The numbers of all effects in one fit, in the order in which they were added."""

    value: Array
    """(F,)"""
    covariance: Array
    """(F, F)"""


def fit_with_motion(
    rig: Rig, state: RigState, times: Array, context: RigContext, fitted: FittedExplanation
) -> tuple[RigState, RigContext, FittedExplanation, JointNumbers]:
    """Fit the rig with the numbers of an explanation free. The path of the board is computed again
    from the placements of that fit, which are those of the cameras that are in time.

    Returns:
        The state of the fit, what is known there, the explanation with its numbers there, and the
        numbers of all effects there.
    """
    assert fitted.estimate
    assert fitted.fixed
    explanation = fitted.explanation
    index = next(i for i, c in enumerate(state.cameras) if c.name == explanation.camera)
    motion, value = fitted.fixed, fitted.estimate.value
    beside = (*context.accepted, *fitted.discrepancy)
    random: tuple[RandomMotion, ...] | None = None
    products = context.products
    is_of_camera = motion.columns == context.of_camera(explanation.camera)
    camera = state.cameras[index]
    accepted = len(context.accepted)
    for _ in range(REFITS if explanation.is_late else 1):
        terms = effect_terms(state, index, motion, is_of_camera=is_of_camera)
        cameras = list(state.cameras)
        cameras[index] = replace(camera, terms=terms.joined(camera.terms))
        start = replace(
            state,
            cameras=tuple(cameras),
            numbers=torch.cat([state.numbers, torch.from_numpy(value)]),
            spreads=torch.cat([state.spreads, torch.from_numpy(motion.spread)]),
        )
        refitted = estimate_rig(start, rounds=ROUNDS).state
        context = rig_context(rig, refitted, times)
        aligned = realign(beside, products, context.products)
        if random is None:
            random = realign(fitted.random, products, context.products)
        reduced = ReducedMotions.of(context.products, (*aligned, *random))
        # The number of a term stands behind those of the terms before it.
        entries = slice(len(state.vector()), len(state.vector()) + len(value))
        vector = refitted.vector().numpy() + reduced.step()
        value = vector[entries]
        covariance = reduced.hessian_inverse[entries, entries]
        if explanation.is_late:
            moved = context.motion.after(float(value[0]))
            motion = late_motion(context, explanation.camera, moved, float(value[0]))
            board = context.of_board(explanation.camera)
            random = (RandomMotion(board, roots(moved.covariance), adapts=False),)
    estimate = FixedEstimate(fitted.estimate.log_evidence, value, covariance)
    assert random is not None
    context = replace(context, accepted=(*aligned[:accepted], *random))
    first = entries.start - len(state.numbers)
    numbers = JointNumbers(vector[first:], reduced.hessian_inverse[first:, first:])
    return refitted, context, replace(fitted, estimate=estimate, random=random), numbers


def effect_terms(
    state: RigState, index: int, motion: FixedMotion, *, is_of_camera: bool
) -> PoseTerms:
    """Return the numbers of a fixed motion as terms of one camera's poses.

    Args:
        index: of the camera.
        motion: of this camera, or of the board that it sees.
        is_of_camera: true for the former.
    """
    camera = state.cameras[index]
    by_number = torch.from_numpy(motion.by_number)[camera.placement]  # (V, 6, f)
    first = len(state.numbers)
    entries = torch.arange(first, first + by_number.shape[2])
    zero = torch.zeros_like(by_number)
    if is_of_camera:
        mounting = state.mountings[state.layout.frames[index]]
        to_mounting = torch.from_numpy(np.linalg.inv(mounting_motion(mounting)))
        return PoseTerms(entries, to_mounting @ by_number, zero)
    placements = state.placements[camera.placement, :6].numpy()
    to_placement = torch.from_numpy(motion_in_placement(placements))
    return PoseTerms(entries, zero, to_placement @ by_number)


def stepped(state: RigState, step: Tensor) -> RigState:
    """Return the state after a (S,) step of the rig's vector, with the placements that fit best
    there.
    """
    vector = state.vector() + step
    placements = state.placements
    problem = state.problem()
    for _ in range(SETTLING):
        placements, _ = problem.inner_step(vector, placements)
    return state.at(vector, placements)
