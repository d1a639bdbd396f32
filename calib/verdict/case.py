"""The input of the checks: a calibration, the requested maps, and quantities that are computed
once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.effects.inner_surface import InnerSurface
from calib.effects.registry import EFFECTS
from calib.estimation.corner_cells import part_rows
from calib.estimation.joint_fit import Estimate
from calib.estimation.noise import MIN_NOISE
from calib.estimation.observations import Observations
from calib.fitting.corner_range import (
    corner_points,
    corner_residuals,
    covered_fraction,
    distance_range,
)
from calib.fitting.declared import comparisons
from calib.fitting.evaluate import Evaluation
from calib.fitting.supported_depths import doubtful_depths
from calib.inference.calibration_model import full_model
from calib.inference.effect_context import effect_context
from calib.inference.fitted_model import FittedModel
from calib.inference.score_test import ScoreTest, score_tests
from calib.session.numbers import unknown_names
from calib.verdict.next_commands import NextCommands

Array = NDArray[np.float64]
SCORED_EFFECTS = tuple(
    kind
    for kind in EFFECTS
    if kind.judged_by_score and not kind.needs_place and kind is not InnerSurface
)
"""Effects with a cheap score test.

The inner surface is excluded: it has many parameters, and the outer relief imitates all but a
thousandth of its effect.
"""


@dataclass(frozen=True, eq=False)
class Case:
    """A calibration with M training corners."""

    calibration: Calibration
    depths: tuple[float, ...]
    """The depths in m of the requested maps; may be empty."""
    next: NextCommands
    evaluation: Evaluation | None
    """The errors on other views, if measured."""
    holdout: str
    """The session of the evaluation's views."""

    @cached_property
    def observations(self) -> Observations:
        return self.calibration.observations

    @cached_property
    def rms_px(self) -> dict[str, float]:
        """The root mean square error in px of each stage."""
        return {stage.name: stage.rms_px for stage in self.calibration.stages}

    @property
    def left_px(self) -> float:
        """The error in px after the last stage."""
        return self.calibration.stages[-1].rms_px

    @cached_property
    def distances_of_glass(self) -> tuple[Array, Array]:
        """(m,) m, from the pinhole to where the rays of some corners, spread evenly, leave the
        cover, and (m,) m to these corners.
        """
        path, values = self.calibration.model()
        rows = part_rows(self.observations)
        observations = self.observations.select_rows(rows)
        rays = path.trace(observations.pixels, values, observations.exposure)
        to_glass = np.linalg.norm(rays.origin.stacked().numpy(), axis=-1)
        return to_glass, np.linalg.norm(self.corners[rows.numpy()], axis=-1)

    @cached_property
    def corners(self) -> Array:
        """(M, 3) m, in the camera frame."""
        return corner_points(self.calibration)

    @property
    def distance(self) -> Array:
        """(M,) m, the distance of each corner (`Path.distance`)."""
        path, _ = self.calibration.model()
        return np.asarray(path.distance(torch.from_numpy(self.corners)).numpy())

    @property
    def reach(self) -> tuple[float, float]:
        """m: how far away the nearest and the farthest corner are (`distance_range`)."""
        return distance_range(self.distance)

    @cached_property
    def covered(self) -> float:
        """The fraction of the image's cells that have corners, 0 to 1 (`covered_fraction`)."""
        return covered_fraction(self.calibration, self.observations.pixels.numpy())

    @property
    def at_optimum(self) -> bool:
        """True if the fit ended at the maximum of its posterior. The paper's method, which has no
        covariance, does not.
        """
        return self.calibration.covariance.size > 0 or not self.calibration.relief

    @property
    def optimum(self) -> FittedModel:
        """Return the fitted model of the calibration."""
        return optimum_of(self.calibration)

    @property
    def scores(self) -> tuple[ScoreTest, ...]:
        """The score tests of SCORED_EFFECTS in their simplest forms; empty if the fit did not end
        at its optimum.
        """
        return _scores(self.calibration) if self.at_optimum else ()

    @property
    def from_optimum(self) -> float:
        """The distance of the shared parameters from the optimum in standard deviations: the root
        of the Newton decrement.
        """
        fitted = self.optimum
        views = [view.reduce() for view in fitted.equations()]
        residual = np.concatenate([view.residual for view in views])
        jacobian = np.concatenate([view.jacobian for view in views])
        precision = fitted.prior_precision()
        gradient = jacobian.T @ residual + precision @ fitted.deviation
        return float(
            np.sqrt(gradient @ np.linalg.solve(jacobian.T @ jacobian + precision, gradient))
        )

    @property
    def has_unknown(self) -> bool:
        """True if the session leaves a number of camera or cover unknown, so that it describes no
        camera to compare the pictures with.
        """
        declared = self.calibration.declared
        return bool(unknown_names(declared.intrinsics, declared.cover))

    @property
    def tried_all_shapes(self) -> bool:
        """True if the session leaves the shape of the cover unknown: the fit has tried all."""
        return bool(self.calibration.outcome.probable_shapes)

    @property
    def other_shape(self) -> str:
        """The words for a cover of another shape than the fitted one, and how to find it."""
        if self.tried_all_shapes:
            return "the cover has a shape that calib does not know"
        return f"the cover has another shape (try {self.next.unknown_cover})"

    @property
    def corrected(self) -> tuple[str, ...]:
        """Names of declared numbers that the views correct, the largest deviation first."""
        if not self.calibration.covariance.size:
            return ()
        numbers = [number for number in comparisons(self.calibration) if number.corrected]
        return tuple(
            number.name
            for number in sorted(numbers, key=lambda number: -number.normalised_deviation)
        )

    @property
    def main_depth(self) -> float:
        """The depth in m of the commands that use the calibration: the first that was asked for,
        now or by the fit, and that the corners support; or else their median distance. Without a
        cover, every depth has the same map.
        """
        asked = self.next.depths or self.depths
        limited = self.calibration.model()[0].cover and self.distance.size
        doubtful = doubtful_depths(asked, *self.reach) if limited else ()
        supported = [depth for depth in asked if depth not in doubtful]
        return supported[0] if supported else self._median_distance

    @property
    def usual_depths(self) -> tuple[float, ...]:
        """The depths of the requested maps in m, or else the median distance of the corners."""
        return self.depths or (self._median_distance,)

    @property
    def _median_distance(self) -> float:
        return float(f"{np.median(self.distance):.2g}")


@lru_cache(maxsize=1)  # a report and the command that writes it both judge
def optimum_of(calibration: Calibration) -> FittedModel:
    """Return the fitted model of the calibration."""
    model = full_model(calibration)
    joint = calibration.outcome.joint
    estimate = Estimate(
        values=calibration.model()[1],
        poses=torch.from_numpy(calibration.poses),
        covariance=torch.from_numpy(calibration.covariance),
        sigma=max(MIN_NOISE, calibration.corner_sigma_px),
        smoothness=joint.relief_prior if joint else None,
        parameters=model.parameters,
    )
    return FittedModel(model, calibration.observations, estimate)


@lru_cache(maxsize=1)
def averaged_optimum_of(calibration: Calibration) -> FittedModel:
    """Return the fitted model of the calibration with averages of its corners, if they are very
    many.
    """
    return optimum_of(calibration).averaged(corner_residuals(calibration).image)


@lru_cache(maxsize=1)
def _scores(calibration: Calibration) -> tuple[ScoreTest, ...]:
    fitted = averaged_optimum_of(calibration)
    context = effect_context(fitted, calibration.board, calibration.camera, locate=False)
    present = {effect.name for effect in fitted.model.effects}
    candidates = [
        (*effect.alternatives(), effect)[0]
        for kind in SCORED_EFFECTS
        if kind.name not in present
        for effect in kind.propose(context)
    ]
    return tuple(score_tests(fitted, candidates))
