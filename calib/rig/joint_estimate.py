"""The joint estimate of a rig: all cameras, their mountings and the placements of the board."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.estimation.camera_model import CameraModel
from calib.estimation.covariance import invert_precision
from calib.estimation.joint_fit import MAX_ITERATIONS
from calib.estimation.levenberg_marquardt import Outcome, Solution, minimise
from calib.estimation.normal_equations import solve
from calib.estimation.objective import LandingProblem, view_precision
from calib.estimation.observations import Observations
from calib.estimation.residual_blocks import make_residual_blocks, pixel_weights
from calib.estimation.residuals import reach_board
from calib.estimation.surface_prior import (
    MarginalLikelihood,
    Quadratic,
    Smoothness,
    maximise_evidence,
)
from calib.optics.params import Values
from calib.rig.layout import RigLayout
from calib.rig.pose_terms import PoseTerms
from calib.rig.poses import compose
from calib.rig.problem import (
    BaselinePrior,
    CameraProblem,
    RigProblem,
    rig_precision,
)

Array = NDArray[np.float64]

ROUNDS = (1e-3, 1e-5)
"""The tolerances of consecutive rounds. Between them, the smoothness of each camera's glass and the
weights of the corners are estimated again.
"""


@dataclass(frozen=True, slots=True, eq=False)
class CameraState:
    """A camera of the rig at some point of the fit."""

    name: str
    model: CameraModel
    """The ray path with the priors of its parameters."""
    observations: Observations
    placement: Tensor
    """(V,) int64: the placement of each view."""
    values: Values
    """Every value of the path."""
    sigma: float
    """px: the standard deviation of a corner in x and in y."""
    smoothness: Smoothness | None
    terms: PoseTerms | None = None
    """Numbers of the rig by which the poses of the views differ; the entries count `numbers`."""


@dataclass(frozen=True, slots=True, eq=False)
class RigState:
    """The cameras, mountings and placements of a rig at some point of the fit."""

    cameras: tuple[CameraState, ...]
    layout: RigLayout
    nominal: Tensor
    """(C, 6) T_camera_reference at the zero vector; zero for the reference."""
    mountings: Tensor
    """(C, 6) T_camera_reference."""
    placements: Tensor
    """(P, B) T_reference_board, and the bend of the board if it bends differently in every
    placement.
    """
    baseline: BaselinePrior | None = None
    numbers: Tensor = field(default_factory=lambda: torch.zeros(0, dtype=torch.float64))
    """(E,) the numbers of effects of the rig, on which the cameras' `terms` depend."""
    spreads: Tensor = field(default_factory=lambda: torch.zeros(0, dtype=torch.float64))
    """(E,) the standard deviations of their priors, whose means are zero."""

    def poses(self, camera: int) -> Tensor:
        """Return the (V, B) T_camera_board of one camera's views, in the frame in which its boards
        are placed, and the bends of the boards.
        """
        state = self.cameras[camera]
        mounting = self.mountings[self.layout.frames[camera]]
        placements = self.placements[state.placement]
        if state.terms:
            mounting, placements = state.terms.moved(mounting, placements, self.numbers)
        return compose(mounting, placements)

    def vector(self) -> Tensor:
        """Return the (S,) vector: each parameter as its deviation from the mean of its prior, each
        mounting from the nominal one, and the numbers of effects of the rig.
        """
        vector = torch.zeros(self.layout.count, dtype=torch.float64)
        for camera, columns in zip(self.cameras, self.layout.columns, strict=True):
            vector[columns] = camera.model.parameters.vector(camera.values)
        for index, entries in enumerate(self.layout.mountings):
            if len(entries):
                vector[entries] = self.mountings[index] - self.nominal[index]
        return torch.cat([vector, self.numbers])

    def at(self, vector: Tensor, placements: Tensor) -> RigState:
        """Return the state at another vector and at other placements."""
        cameras = tuple(
            replace(camera, values=camera.model.parameters.values(vector[columns]))
            for camera, columns in zip(self.cameras, self.layout.columns, strict=True)
        )
        mountings = self.nominal.clone()
        for index, entries in enumerate(self.layout.mountings):
            if len(entries):
                mountings[index] += vector[entries]
        return replace(
            self,
            cameras=cameras,
            mountings=mountings,
            placements=placements,
            numbers=vector[self.layout.count :],
        )

    def select_placements(self, placements: range) -> RigState:
        """Return the state with some consecutive placements and their views only."""
        cameras = []
        for camera in self.cameras:
            selected_views = (camera.placement >= placements.start) & (
                camera.placement < placements.stop
            )
            views = camera.observations.without_views(~selected_views)
            placement = camera.placement[selected_views] - placements.start
            terms = camera.terms.select(selected_views) if camera.terms else None
            cameras.append(replace(camera, observations=views, placement=placement, terms=terms))
        selected = self.placements[placements.start : placements.stop]
        return replace(self, cameras=tuple(cameras), placements=selected)

    def problem(self) -> RigProblem:
        """Return the solver's problem, linearised in the weights of the corners at this state."""
        problems = []
        priors = []
        for index, camera in enumerate(self.cameras):
            parameters = camera.model.parameters
            path = camera.model.path
            poses = self.poses(index)
            observations = camera.observations
            weights = pixel_weights(path, camera.values, observations, poses, camera.sigma)
            blocks = make_residual_blocks(path, parameters, observations, weights, camera.values)
            precision = torch.from_numpy(parameters.prior_precision(camera.smoothness))
            landing = LandingProblem(
                parameters, tuple(blocks), precision, poses.new_zeros(poses.shape[1])
            )
            frame = self.layout.frames[index]
            problems.append(
                CameraProblem(
                    landing,
                    self.layout.columns[index],
                    self.nominal[frame],
                    self.layout.mountings[frame],
                    camera.placement,
                    self._terms_in_vector(camera),
                )
            )
            priors.append((self.layout.columns[index], precision))
        priors.append((self._number_entries(), self.spreads.pow(-2).diag()))
        precision = rig_precision(priors, self.layout.count + len(self.numbers))
        mounting = None
        if self.baseline:
            place = self.baseline.camera
            mounting = self.nominal[place], self.layout.mountings[place]
        path = self.cameras[0].model.path  # all cameras see the same board
        return RigProblem(
            cameras=tuple(problems),
            precision=precision,
            block_precision=view_precision(path, self.placements),
            baseline=self.baseline,
            mounting=mounting,
        )

    def _number_entries(self) -> Tensor:
        """Return the (E,) places of the numbers of effects in the vector."""
        return torch.arange(self.layout.count, self.layout.count + len(self.numbers))

    def _terms_in_vector(self, camera: CameraState) -> PoseTerms | None:
        """Return a camera's terms with entries that count the vector."""
        terms = camera.terms
        return replace(terms, entries=self.layout.count + terms.entries) if terms else None


@dataclass(frozen=True, slots=True, eq=False)
class RigEstimate:
    """The most probable rig, and its covariance."""

    state: RigState
    covariance: Tensor
    """(S, S) covariance of the rig's vector; placements are marginalised. NaN if the fit is not
    finite.
    """
    outcome: Outcome
    iterations: int
    """The number of linearisations in all rounds."""
    cost: float
    """The robust squares of the corners over sigma squared, plus those of the priors."""
    problem: RigProblem = field(repr=False)
    """The problem of the last round."""
    vector: Tensor = field(repr=False)
    """(S,) the solution of the last round."""


def estimate_rig(
    state: RigState,
    *,
    rounds: Sequence[float] = ROUNDS,
    fixed_smoothness: bool = False,
    progress: Callable[[int, float], None] | None = None,
) -> RigEstimate:
    """Fit all cameras, mountings and placements together, from a start.

    The noise of each camera is that of its own fit: a rig's corners are the same corners.

    Args:
        state: the start. Corners whose rays do not reach the board there are left out.
        rounds: the tolerances of consecutive rounds.
        fixed_smoothness: True to keep the smoothness of each camera's glass.
        progress: called with the number of linearisations so far and the cost.
    """
    state = _visible(state)
    iterations = 0
    for tolerance in rounds:
        problem = state.problem()
        solution = minimise(
            problem, state.vector(), state.placements, steps=MAX_ITERATIONS, tolerance=tolerance
        )
        iterations += solution.iterations
        state = state.at(solution.shared, solution.blocks)
        if progress:
            progress(iterations, solution.cost)
        if solution.outcome is Outcome.NOT_FINITE:
            break
        if tolerance != rounds[-1] and not fixed_smoothness:
            state = _with_smoothness(state, problem, solution)
    hessian = solution.equations.eliminate_blocks().hessian
    covariance = invert_precision(hessian + problem.precision)
    finite = solution.outcome is not Outcome.NOT_FINITE and bool(covariance.isfinite().all())
    return RigEstimate(
        state=state,
        covariance=covariance if finite else torch.full_like(covariance, torch.nan),
        outcome=solution.outcome if finite else Outcome.NOT_FINITE,
        iterations=iterations,
        cost=solution.cost,
        problem=problem,
        vector=solution.shared,
    )


def _visible(state: RigState) -> RigState:
    """Return the state without the corners whose rays do not reach the board."""
    cameras = []
    for index, camera in enumerate(state.cameras):
        observations = camera.observations
        reached = reach_board(camera.model.path, camera.values, observations, state.poses(index))
        cameras.append(replace(camera, observations=observations.select_rows(reached)))
    return replace(state, cameras=tuple(cameras))


def _with_smoothness(state: RigState, problem: RigProblem, solution: Solution) -> RigState:
    """Return the state with the most probable smoothness of each camera's glass, given that of the
    other cameras, with everything but the camera's parameters integrated out.
    """
    reduced = solution.equations.eliminate_blocks()
    hessian, gradient = reduced.hessian, reduced.gradient
    cameras = list(state.cameras)
    for index, camera in enumerate(state.cameras):
        parameters = camera.model.parameters
        columns = state.layout.columns[index]
        if not parameters.relief or not camera.smoothness or parameters.glass_prior:
            continue
        is_other = torch.ones(len(solution.shared), dtype=torch.bool)
        is_other[columns] = False
        rest_entries = is_other.nonzero().squeeze(-1)
        prior = problem.precision[rest_entries[:, None], rest_entries]
        cross = hessian[rest_entries[:, None], columns]  # (O, S_c)
        pull = gradient[rest_entries] + prior @ solution.shared[rest_entries]
        right_side = torch.cat([cross, pull[:, None]], 1)
        response = solve(hessian[rest_entries[:, None], rest_entries] + prior, right_side)
        marginal = hessian[columns[:, None], columns] - cross.mT @ response[:, :-1]
        score = gradient[columns] - cross.mT @ response[:, -1]
        vector = solution.shared[columns].numpy()
        quadratic = Quadratic.around(marginal.numpy(), score.numpy(), 0.0, 0, vector)
        evidence = MarginalLikelihood(quadratic, parameters.relief, parameters.free_root())
        _, smoothness = maximise_evidence(evidence, 1.0, camera.smoothness, fixed_noise=True)
        cameras[index] = replace(camera, smoothness=smoothness)
    return replace(state, cameras=tuple(cameras))
