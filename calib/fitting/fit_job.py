"""The joint fits of one camera: each starts with a part of the corners if there are very many, goes
on to all of them, and ends with the decision whether the board is bent.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from calib.calibration_content import Stage
from calib.estimation.camera_model import CameraModel
from calib.estimation.corner_cells import average_corners, is_large, spread_part
from calib.estimation.joint_fit import FIRST_SIGMA, ROUNDS, JointFit, Start
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.estimation.stated_priors import priors_of
from calib.estimation.surface_prior import Smoothness
from calib.estimation.uneven_glass import uneven_log_odds
from calib.fit_record.request import Settings
from calib.fitting.board_turns import find_turned
from calib.fitting.fit_result import EFFECTS_STAGE
from calib.fitting.fitted import COVER_STAGE, PINHOLE_STAGE, Fitted, OnAverages, stage_of
from calib.fitting.seen_glass import seen_relief
from calib.fitting.setup import Setup
from calib.inference.board_bend import estimate_board
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import Relief
from calib.progress import Progress
from calib.session.cover import EVEN
from calib.session.parameter_names import COVER

MAX_PULL = 10.0
"""Tolerances: a declared number of the cover that even glass moves farther is no start for uneven
glass. A cone with bumps of 30 um can be imitated by one whose radius is zero.
"""
LAST_ROUNDS = (3e-4, 1e-6)
"""The tolerances of a fit to very many corners that starts next to its optimum. Where it ends, a
step would lower the squares of a million corners by 2 or less in all, for thousands of numbers:
each is about a hundredth of its standard deviation from the optimum.
"""
LINEARISATIONS = 12
"""Length of the progress bar: a joint fit takes about as many."""


@dataclass(frozen=True, slots=True)
class FitJob:
    """The arguments of `fit_stages`, and the stages so far."""

    setup: Setup
    observations: Observations
    settings: Settings
    progress: Progress
    purpose: str
    stages: tuple[Stage, ...]
    labels: NDArray[np.int64] | None
    decided: Fitted | None

    @property
    def surface(self) -> str:
        """Whether the outer surface is even, as the session or the grid says it."""
        return EVEN if self.settings.is_even else self.setup.cover.covers[-1].surface

    def initial(self, values: Values) -> Start | None:
        """Return the start of a fit with unknown numbers, from the initial values of its path; None
        if all numbers are known.
        """
        return Start(dict(values), FIRST_SIGMA, None) if self.setup.initial else None

    @property
    def decides_bend(self) -> bool:
        """True if it is not decided whether the board is bent."""
        return self.decided is None and self.settings.estimates_bend

    def model(self, path: Path, values: Values) -> CameraModel:
        """Return the model of a path, with the board's bend if it is decided."""
        priors = priors_of(self.setup.intrinsics, self.setup.cover, path)
        effects = self.decided.effects if self.decided else ()
        return CameraModel(path, values, priors).with_effects(effects)

    @property
    def part(self) -> FitJob:
        """The same with a part of the corners, if they are very many: what it finds is the start of
        `complete`.
        """
        corners = spread_part(self.observations)
        return self if corners is self.observations else replace(self, observations=corners)

    def complete(self, model: CameraModel, joint: JointFit) -> tuple[JointFit, OnAverages | None]:
        """Return the fit to all corners, from that to a part of them. Between these two, a fit to
        averages of all corners comes so near to the optimum that one step of all corners remains.
        """
        observations = self.observations
        if not is_large(observations) or not joint.finite:
            return joint, None
        path, values, poses = model.path, joint.values, joint.poses
        averages = average_corners(path, values, observations, poses, joint.sigma)
        near = replace(self, observations=averages).fit(model, poses, joint.start)
        if not near.finite:
            return near, None
        on_averages = OnAverages(averages, near)
        return self.fit(model, near.poses, near.start, LAST_ROUNDS), on_averages

    def log_odds_of_texture(self, model: CameraModel, joint: JointFit) -> tuple[float, Smoothness]:
        """Return `uneven_log_odds` of the fit of a model without a relief."""
        relief = seen_relief(self.setup, self.settings, model.path, joint.values)
        return uneven_log_odds(model, joint, self.observations, relief)

    def fit(
        self,
        model: CameraModel,
        poses: Tensor,
        start: Start | None,
        rounds: Sequence[float] = ROUNDS,
    ) -> JointFit:
        """Return the joint fit of a model."""
        is_uneven = bool(model.path.relief)
        title = "Rough fit" if len(rounds) == 1 else "Joint fit"
        if is_uneven:
            title = "Uneven glass, roughly" if len(rounds) == 1 else "Uneven glass"
        if self.purpose:
            title = f"{'Uneven' if is_uneven else 'Fit'}, {self.purpose}"
        advance = self.progress.task(title, LINEARISATIONS)
        joint = model.fit(
            self.observations,
            poses,
            start,
            rounds,
            progress=lambda count, rms: advance(min(count, LINEARISATIONS), f"{rms:.3f} px"),
        )
        advance(LINEARISATIONS, "")
        return joint

    def finish_all(
        self, model: CameraModel, joint: JointFit, relief: Relief | None = None
    ) -> Fitted:
        """Return `finish` of the fit to all corners, from that to a part of them."""
        completed, on_averages = self.complete(model, joint)
        return self.finish(model, completed, relief, on_averages)

    def is_possible(self, model: CameraModel, joint: JointFit) -> bool:
        """Return True if the cover's estimated numbers are within the limits of what a session may
        declare, and not far from what this one declares.
        """
        for name, kind in self.setup.cover.kinds.items():
            sigma = model.priors.sigmas.get(full_name := COVER.of(name))
            if sigma is not None:
                low, high = kind.quantity.low, kind.quantity.high
                value, mean = float(joint.values[full_name]), float(model.means[full_name])
                is_near = abs(value - mean) <= MAX_PULL * float(sigma)
                if not (is_near and low <= value * kind.quantity.unit[1] <= high):
                    return False
        return True

    def finish(
        self,
        model: CameraModel,
        joint: JointFit,
        relief: Relief | None = None,
        on_averages: OnAverages | None = None,
    ) -> Fitted:
        """Return the fit of a flat board, or that of a bent one if the views show the bend."""
        residual = residuals(model.path, joint.values, self.observations, joint.poses)
        flat = stage_of(COVER_STAGE if model.path.cover else PINHOLE_STAGE, residual)
        if self.decided and self.decided.effects:
            flat = self.decided.stages[-2]
        stages = (*self.stages, flat)
        turned: tuple[str, ...] = ()
        if self.decides_bend:
            board = self.setup.board
            asked = on_averages or OnAverages(self.observations, joint)
            is_turned = find_turned(model, asked.observations, asked.joint, board)
            turned = tuple(compress(self.observations.names, is_turned))
            model, decided = estimate_board(
                model, asked.observations, asked.joint, board, self.labels
            )
            if decided is not asked.joint:
                joint = decided
                if on_averages:
                    joint, on_averages = self.complete(model, decided)
                residual = residuals(model.path, joint.values, self.observations, joint.poses)
        if model.effects:
            stages = (*stages, stage_of(EFFECTS_STAGE, residual))
        return Fitted(
            path=model.path,
            values=joint.values,
            poses=joint.poses,
            stages=stages,
            residuals=residual,
            relief=relief,
            joint=joint,
            model=model,
            turned=turned,
            on_averages=on_averages,
        )
