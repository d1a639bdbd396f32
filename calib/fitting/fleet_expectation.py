"""A fit that starts from a fleet's prior of its camera, and the test of that prior by the views."""

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
from calib.fit_record.outcome import FleetPriorTest
from calib.fit_record.request import Settings
from calib.fitting.fitted import Fitted
from calib.fitting.inputs import FitInputs
from calib.fitting.resolve_prior_conflict import (
    ResolvedFit,
    at_noise,
    log_evidence,
    resolve_prior_conflict,
)
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.progress import Progress
from calib.session.fleet_prior import FleetPrior, combine_with_prior
from calib.session.numbers import covariance_of
from calib.session.session import Session

FALSE_ALARM = 0.01
"""Probability that a camera of the fleet is taken for one that contradicts the prior. Such a camera
only loses what the prior would have given.
"""


@dataclass(frozen=True, slots=True)
class Expectation:
    """A session's setup with its fleet's prior and without it."""

    prior: FleetPrior
    with_prior: Setup
    """The setup with the fleet's prior."""
    without_prior: Setup
    """The setup as the session describes it."""

    @staticmethod
    def of(session: Session, start: FitInputs) -> Expectation | None:
        """Return the expectation, or None if the session names no prior.

        Raises:
            InputError: the prior is of another make.
        """
        if not (prior := session.prior):
            return None
        without_prior = Setup(session.board, session.camera, start.intrinsics, session.cover)
        camera_intrinsics = (
            prior.intrinsics if start.intrinsics_from == "prior" else start.intrinsics
        )
        intrinsics, cover = combine_with_prior(
            prior, camera_intrinsics, session.cover, str(session.path / "session.yaml")
        )
        with_prior = replace(without_prior, intrinsics=intrinsics, cover=cover)
        return Expectation(prior, with_prior, without_prior)

    def resolve(
        self, fitted: Fitted, views: tuple[View, ...], settings: Settings, progress: Progress
    ) -> tuple[ResolvedFit, FleetPriorTest]:
        """Return a fit with the prior, or without it where the views contradict it, and the record
        of that decision.

        The views contradict the prior in two cases. They pull the camera's numbers farther than
        only FALSE_ALARM of the fleet's cameras would be. Or the residual exceeds the corners' noise
        and a fit without the prior is more probable.
        """
        setup = self.with_prior.with_tolerances(settings)
        conflict, pulls = self._prior_conflict(fitted)
        is_outlier = conflict.p_value < FALSE_ALARM
        if is_outlier or not at_noise(ResolvedFit(fitted, setup, setup), views):
            free_setup = self.without_prior.with_tolerances(settings)
            observations = Observations.of(views, setup.board)
            refitted = fit_stages(
                free_setup,
                observations,
                settings,
                progress,
                decided=fitted,
                purpose="no fleet prior",
            )
            if is_outlier or log_evidence(refitted) > log_evidence(fitted):
                resolved = resolve_prior_conflict(
                    refitted, free_setup, self.without_prior, views, settings, progress
                )
                return resolved, self._record(conflict, pulls, used=False)
        resolved = resolve_prior_conflict(fitted, setup, self.with_prior, views, settings, progress)
        return resolved, self._record(conflict, pulls, used=True)

    def _prior_conflict(self, fitted: Fitted) -> tuple[PriorConflict, dict[str, float]]:
        """Return the conflict of all numbers together, and by name how far the views pull each
        number, in standard deviations.
        """
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
        mean = np.array([float(joint.values[name]) for name in names])
        prior_mean = np.array([float(parameters.origin[name]) for name in names])
        prior = covariance_of(self.with_prior.intrinsics, self.with_prior.cover, names)
        likelihood = LikelihoodInformation.between(mean, covariance, prior_mean, prior)
        deviations = likelihood.deviations(prior_mean, prior)
        pulls = dict(zip(names, map(float, deviations), strict=True))
        return prior_conflict(likelihood, prior_mean, prior), pulls

    def _record(
        self, conflict: PriorConflict, pulls: dict[str, float], *, used: bool
    ) -> FleetPriorTest:
        farthest = max(pulls, key=lambda name: abs(pulls[name]), default="")
        return FleetPriorTest(
            file=str(self.prior.file.resolve()),
            sha256=self.prior.sha256,
            cameras=self.prior.cameras,
            used=used,
            p_value=conflict.p_value,
            farthest=farthest,
            farthest_sigmas=abs(pulls.get(farthest, 0.0)),
        )
