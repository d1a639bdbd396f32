"""What the checks of a verdict go by: a calibration, what is wanted of it, and its model asked at
the training corners, each thing once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.diagnosis.fine_surface_search import surroundings
from calib.diagnosis.score_test import Optimum, ScoreTest
from calib.diagnosis.starting_model import model_of
from calib.effects.inner_surface import InnerSurface
from calib.effects.registry import EFFECTS
from calib.estimation.elimination import eliminated
from calib.estimation.joint_fit import JointFit
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.observations import Observations
from calib.estimation.surface_prior import Smoothness
from calib.fitting.declared import comparisons
from calib.fitting.evaluate import Evaluation
from calib.optics.rays import Rays
from calib.verdict.next_commands import NextCommands
from calib.verdict.thresholds import CELLS

Array = NDArray[np.float64]
ASKED = tuple(
    kind
    for kind in EFFECTS
    if kind.judged_by_score and not kind.needs_place and kind is not InnerSurface
)
"""Cheap to ask.

The inner surface has many parameters, of which the outer one's relief imitates all but a
thousandth.
"""


@dataclass(frozen=True, eq=False)
class Case:
    """A calibration with M training corners."""

    calibration: Calibration
    depths: tuple[float, ...]
    """m, for which maps are wanted; none were asked for."""
    next: NextCommands
    evaluation: Evaluation | None
    """How it did on other views, if that was measured."""
    holdout: str
    """The session of these views."""

    @cached_property
    def observations(self) -> Observations:
        return self.calibration.observations

    @cached_property
    def rms_px(self) -> dict[str, float]:
        """By stage."""
        return {stage.name: stage.rms_px for stage in self.calibration.stages}

    @property
    def left_px(self) -> float:
        """After the last stage."""
        return self.calibration.stages[-1].rms_px

    @cached_property
    def rays(self) -> Rays:
        """(M,) of the corners, where they leave the cover."""
        path, values = self.calibration.model()
        return path.trace(self.observations.pixels, self.observations.with_times(values))

    @cached_property
    def corners(self) -> Array:
        """(M, 3) m, in the camera frame."""
        path, values = self.calibration.model()
        poses = torch.from_numpy(self.calibration.poses)[self.observations.view]
        return np.asarray(
            path.place(
                self.observations.corners, self.observations.with_times(values), poses
            ).numpy()
        )

    @property
    def distance(self) -> Array:
        """(M,) m, how far away each corner is (`Path.distance`)."""
        path, _ = self.calibration.model()
        return np.asarray(path.distance(torch.from_numpy(self.corners)).numpy())

    @property
    def reach(self) -> tuple[float, float]:
        """m: how far away the nearest and the farthest corner are. A corner behind a lens that is
        not wide does not count, as the model does not see it, unless all are there.
        """
        ahead = self.distance > 0
        counted = self.distance[ahead | ~ahead.any()]
        return float(counted.min()), float(counted.max())

    @cached_property
    def covered(self) -> float:
        """The part of the image's cells that has corners. A cell without any counts if its middle
        sees forward: nobody says where the picture of a wide lens ends, and no undistorted picture
        holds what is beside the camera.
        """
        sizes = np.array([self.calibration.camera.width, self.calibration.camera.height])
        cell = ((self.observations.pixels.numpy() + 0.5) / sizes * CELLS).astype(np.int64)
        column, row = np.clip(cell, 0, np.array(CELLS) - 1).T
        has_corners = np.zeros(CELLS, dtype=np.bool_)
        has_corners[column, row] = True
        middles = np.stack(np.meshgrid(*map(np.arange, CELLS), indexing="ij"), -1) + 0.5
        pixels = torch.from_numpy(middles * sizes / CELLS - 0.5)
        path, values = self.calibration.model()
        forward = np.ones(CELLS, dtype=np.bool_)
        if path.lens.wide:
            forward = path.trace(pixels, values).in_pinhole.numpy()
        return float(has_corners.sum() / (has_corners | forward).sum())

    @property
    def at_optimum(self) -> bool:
        """Whether the fit ended where its parameters are most probable; the paper's method, which
        has no covariance, does not.
        """
        return self.calibration.covariance.size > 0 or not self.calibration.relief

    @property
    def optimum(self) -> Optimum:
        """The fit where it ended."""
        return optimum_of(self.calibration)

    @property
    def scores(self) -> tuple[ScoreTest, ...]:
        """Of the effects that are asked, in their simplest forms; none where the fit did not end at
        its optimum.
        """
        return _scores(self.calibration) if self.at_optimum else ()

    @property
    def from_optimum(self) -> float:
        """How far the shared parameters are from the optimum, in standard deviations of what they
        are known to: the root of the Newton decrement.
        """
        at = self.optimum
        views = list(at.equations())
        off = np.concatenate([eliminated(view.own, view.residual) for view in views])
        rows = np.concatenate([eliminated(view.own, view.shared) for view in views])
        precision = at.prior_precision()
        gradient = rows.T @ off + precision @ at.deviation
        return float(np.sqrt(gradient @ np.linalg.solve(rows.T @ rows + precision, gradient)))

    @property
    def corrected(self) -> tuple[str, ...]:
        """The declared numbers that the views tell from what is declared, the farthest first."""
        if not self.calibration.covariance.size:
            return ()
        found = [one for one in comparisons(self.calibration) if one.corrected]
        return tuple(one.name for one in sorted(found, key=lambda one: -one.apart))

    @property
    def usual_depths(self) -> tuple[float, ...]:
        """m: those that maps are wanted for, or else the corners' median."""
        return self.depths or (float(f"{np.median(self.distance):.2g}"),)


@lru_cache(maxsize=1)  # a report and the command that writes it both judge
def optimum_of(calibration: Calibration) -> Optimum:
    """The fit where it ended."""
    model, prior = model_of(calibration), calibration.settings.get("relief_prior")
    joint = JointFit(
        values=calibration.model()[1],
        poses=torch.from_numpy(calibration.poses),
        covariance=torch.from_numpy(calibration.covariance),
        cost=np.nan,
        sigma=float(calibration.settings.get("sigma_px", calibration.stages[-1].rms_px / 2**0.5)),
        smoothness=Smoothness(prior["height_m"], prior["length_of_patch"]) if prior else None,
        parameters=model.parameters,
        outcome=Outcome.CONVERGED,
        iterations=0,
        log_evidence=np.nan,
        log_marginal=np.nan,
    )
    return Optimum(model, calibration.observations, joint)


@lru_cache(maxsize=1)
def _scores(calibration: Calibration) -> tuple[ScoreTest, ...]:
    at = optimum_of(calibration)
    there = surroundings(at, calibration.board, calibration.camera, place=False)
    present = {effect.name for effect in at.model.effects}
    asked = [
        (*effect.alternatives(), effect)[0]
        for kind in ASKED
        if kind.name not in present
        for effect in kind.propose(there)
    ]
    return tuple(at.tests(asked))
