"""A fit that begins with what a fleet expects of its camera, and what its views then say of
that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.corners.view import View
from calib.estimation.likelihood_information import (
    LikelihoodInformation,
    PriorConflict,
    prior_conflict,
)
from calib.estimation.observations import Observations
from calib.fitting.believing import Believed, at_noise, believing, log_evidence
from calib.fitting.inputs import Gathered
from calib.fitting.stages import Fitted, Settings, Setup, fit_stages
from calib.progress import Progress
from calib.session.fleet_prior import FleetPrior, combine_with_prior
from calib.session.numbers import covariance_of
from calib.session.session import Session

KEY = "fleet_prior"
"""Of a calibration's settings: the prior that its session names, and what became of it."""
REFUSED = 0.01
"""Chance that a camera as the fleet expects it is taken for another: then it only loses what the
prior would have given.
"""


@dataclass(frozen=True, slots=True)
class Expectation:
    """A session's setup with its fleet's prior, and without."""

    prior: FleetPrior
    told: Setup
    """With it."""
    alone: Setup
    """As the session describes it."""

    @staticmethod
    def of(session: Session, start: Gathered) -> Expectation | None:
        """None where the session names no prior.

        Raises:
            InputError: the prior is of another make.
        """
        if not (prior := session.prior):
            return None
        alone = Setup(session.board, session.camera, start.intrinsics, session.cover)
        own = prior.intrinsics if start.intrinsics_from == "prior" else start.intrinsics
        intrinsics, cover = combine_with_prior(
            prior, own, session.cover, str(session.path / "session.yaml")
        )
        return Expectation(prior, replace(alone, intrinsics=intrinsics, cover=cover), alone)

    def believed(
        self, fitted: Fitted, views: tuple[View, ...], settings: Settings, progress: Progress
    ) -> tuple[Believed, dict[str, object]]:
        """A fit with the prior, or one without where the views contradict it; and what is said of
        that in a calibration's settings.

        They contradict it where they pull the camera's numbers farther than one of REFUSED of such
        cameras would be, or leave more than the corners' noise, which a fit without it explains
        better.
        """
        setup = self.told.freed(settings)
        found, numbers = self._surprise(fitted)
        as_told = Believed(fitted, setup, setup)
        away = found.p_value < REFUSED
        if away or not at_noise(as_told, views):
            own = self.alone.freed(settings)
            observations = Observations.of(views, setup.board)
            without = fit_stages(
                own, observations, settings, progress, purpose="without the fleet's prior"
            )
            if away or log_evidence(without) > log_evidence(fitted):
                return believing(without, own, self.alone, views, settings, progress), self._said(
                    found, numbers, used=False
                )
        return believing(fitted, setup, self.told, views, settings, progress), self._said(
            found, numbers, used=True
        )

    def _surprise(self, fitted: Fitted) -> tuple[PriorConflict, dict[str, float]]:
        """Of the whole, and how far each number is pulled, in standard deviations."""
        joint = fitted.joint
        names = tuple(
            name for name in self.prior.names if joint and name in joint.parameters.priors.sigmas
        )
        if not (joint and joint.finite and names):
            return PriorConflict(0.0, 0, 1.0), {}
        parameters = joint.parameters
        places = parameters.entries(names)
        scales = np.array(
            [param.scale for name in names for param in parameters.free if param.name == name]
        )
        covariance = joint.covariance.numpy()[np.ix_(places, places)] * scales[:, None] * scales
        mean, before = (
            np.array([float(values[name]) for name in names])
            for values in (joint.values, parameters.origin)
        )
        prior = covariance_of(self.told.intrinsics, self.told.cover, names)
        told = LikelihoodInformation.between(mean, covariance, before, prior)
        pulls = dict(zip(names, map(float, told.deviations(before, prior)), strict=True))
        return prior_conflict(told, before, prior), pulls

    def _said(
        self, found: PriorConflict, pulls: dict[str, float], *, used: bool
    ) -> dict[str, object]:
        farthest = max(pulls, key=lambda name: abs(pulls[name]), default="")
        return {
            "file": str(self.prior.file.resolve()),
            "sha256": self.prior.sha256,
            "cameras": self.prior.cameras,
            "used": used,
            "p_value": found.p_value,
            "farthest": farthest,
            "farthest_sigmas": abs(pulls.get(farthest, 0.0)),
        }
