"""Update of a calibration: a fit to the checked views with the calibration as the prior.

The new views of a valid calibration make its numbers more precise, and are added to its own views.
If one named change of the camera or its cover is found, that change is fitted as well, and only the
new views remain, because the old ones show the camera before the change. The history is kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np
import torch

from calib.calibration import Calibration
from calib.checking.changes import KINDS, changes_of
from calib.checking.cover_spin import CoverSpin
from calib.checking.later_stages import stages_of
from calib.checking.picture_mode import PictureMode
from calib.checking.pictures import Pictures
from calib.checking.prior import CalibrationPrior
from calib.checking.refit import Refit, refit
from calib.checking.result import CheckResult, CheckStatus
from calib.corners.view import View
from calib.effects.effect import Effect
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.joint_fit import Estimate
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refit_poses
from calib.fit_record.history import UpdateRecord
from calib.fit_record.outcome import JointOutcome
from calib.fitting.declared import comparisons
from calib.fitting.fit_result import with_estimate
from calib.optics.relief import AMPLITUDES
from calib.threads import single_thread

NOT_IN_CALIBRATION = frozenset({CoverSpin.name, PictureMode.name, "board_scale", "board_shape"})
"""Changes that a calibration cannot contain, or that are not changes of the camera."""


@dataclass(frozen=True, slots=True)
class NumberUpdate:
    """A number of a calibration and its update, in the unit of session.yaml."""

    name: str
    unit: str
    prior: float
    prior_sigma: float
    updated: float
    updated_sigma: float

    @property
    def sigmas(self) -> float:
        """The shift in standard deviations of the prior."""
        shift = self.updated - self.prior
        return shift / self.prior_sigma if self.prior_sigma > 0 else 0.0

    def as_json(self) -> dict[str, object]:
        return {
            "unit": self.unit,
            "before": self.prior,
            "sigma_before": self.prior_sigma,
            "after": self.updated,
            "sigma_after": self.updated_sigma,
            "moved_sigmas": self.sigmas,
        }


def update(
    calibration: Calibration, prior: CalibrationPrior, result: CheckResult, pictures: Pictures
) -> tuple[Calibration, tuple[NumberUpdate, ...]]:
    """Return the updated calibration, and the update of each of its numbers.

    Raises:
        InputError: the pictures show another board.
        NotEnoughDataError: a calibration of this camera cannot contain the change, or the fit is
            not finite.
    """
    board = calibration.board
    pictured = pictures.board
    if not board.has_grid:
        raise InputError(
            "--update joins pictures of a board only: put the points of all views into one session,"
            " and fit it."
        )
    same_grid = (board.columns, board.rows) == (pictured.columns, pictured.rows)
    if not same_grid or board.square != pictured.square:
        raise InputError(
            f"--update needs pictures of the calibration's own board, {board} of"
            f" {1e3 * board.square:g} mm, not of {pictured} of {1e3 * pictured.square:g} mm:"
            " take pictures of that board, or fit a new session."
        )
    change = _change(result, calibration, prior)
    rejected = {view.name for view in result.rejected}
    views = tuple(view for view in pictures.views if view.name not in rejected)
    with single_thread():
        observations = Observations.of(views, pictures.board).add_times(
            None, calibration.camera.height
        )
        poses = pinhole_poses(prior.model.path, prior.model.means, observations)
        poses, _ = prior.fit_poses(observations, poses)
        fit = refit(prior, change, observations, poses, prior.sigma * _noise_ratio(result))
        if not fit.finite:
            raise NotEnoughDataError(
                "These pictures cannot update the calibration: fit a session of more views."
            )
        updated = _apply_fit(calibration, prior, change, fit, views)
    numbers = tuple(_number_updates(calibration, updated))
    record = UpdateRecord(
        calibration_sha256=calibration.digest,
        finished=datetime.now(UTC).isoformat(timespec="seconds"),
        answer=result.status.value,
        views=tuple(view.name for view in views),
        change=change.name if change else "",
        moved_sigmas={number.name: number.sigmas for number in numbers},
    )
    history = calibration.history
    history = replace(history, updates=(*history.updates, record))
    return replace(updated, history=history), numbers


def is_updatable(result: CheckResult) -> bool:
    """Return True if nothing has changed, or one named change that a calibration can contain."""
    names = [change.name for change in result.changes]
    return result.status is CheckStatus.VALID or (
        len(names) == 1 and names[0] in {kind.name for kind in KINDS} - NOT_IN_CALIBRATION
    )


def _change(
    result: CheckResult, calibration: Calibration, prior: CalibrationPrior
) -> Effect | None:
    if not prior.parameters.count:
        raise NotEnoughDataError(
            "The calibration has no covariance, so a few pictures cannot update it: fit a new"
            " session."
        )
    if result.status is CheckStatus.VALID:
        return None
    if not is_updatable(result):
        reason = (
            str(result.changes[0])
            if len(result.changes) == 1
            else "no single change explains the pictures"
        )
        raise NotEnoughDataError(
            f"The calibration cannot be updated ({reason}): record a new session and fit it."
        )
    return next(
        change for change in changes_of(calibration) if change.name == result.changes[0].name
    )


def _apply_fit(
    calibration: Calibration,
    prior: CalibrationPrior,
    change: Effect | None,
    fit: Refit,
    views: tuple[View, ...],
) -> Calibration:
    """Return the calibration with the numbers of the fit and the views of the camera's new
    state.
    """
    effect_names = {effect.name for effect in prior.model.effects}
    model = prior.model.with_effects([change] if change and change.name not in effect_names else [])
    poses = fit.poses
    taken = {view.name for view in calibration.views}
    views = tuple(replace(view, name=_free_name(view.name, taken)) for view in views)
    if not change:
        views = (*calibration.views, *views)
        if calibration.views:  # a calibration for another medium has none
            initial = torch.from_numpy(calibration.poses)
            old_poses, _ = refit_poses(
                fit.path, fit.values, calibration.observations, initial, sigma=prior.sigma
            )
            poses = torch.cat([old_poses, poses])
    estimate = Estimate(
        values=fit.values,
        poses=poses,
        covariance=torch.from_numpy(fit.covariance),
        sigma=prior.sigma,
        smoothness=None,
        parameters=fit.parameters,
    )
    base = replace(calibration, views=views)
    updated = with_estimate(base, model, estimate, base.observations)
    order = updated.camera_model().parameters  # the order of the parameters
    names = [*([AMPLITUDES] if order.relief else []), *(param.name for param in order.free)]
    places = fit.parameters.entries(names)
    updated = replace(updated, covariance=fit.covariance[np.ix_(places, places)])
    if not calibration.stages:  # its fit saw no view of this medium
        updated = replace(updated, stages=stages_of(updated))
    former = calibration.outcome.joint
    joint = JointOutcome(
        outcome=fit.outcome.value,
        iterations=fit.iterations,
        sigma_px=prior.sigma,
        log_evidence=former.log_evidence if former else None,
        relief_prior=former.relief_prior if former else None,
    )
    # The covariance is that of the prior and the later corners; `overdispersion` has their scatter.
    return replace(updated, outcome=replace(calibration.outcome, joint=joint, uncertainty=None))


def _free_name(name: str, taken: set[str]) -> str:
    """Return a name for a later view that no view of the calibration has."""
    name = f"later-{name}"
    return _free_name(name, taken) if name in taken else name


def _number_updates(prior: Calibration, updated: Calibration) -> Iterator[NumberUpdate]:
    estimates = {number.name: number for number in comparisons(updated)}
    for number in comparisons(prior):
        estimate = estimates[number.name]
        if number.sigma > 0:
            yield NumberUpdate(
                name=number.name,
                unit=number.unit,
                prior=number.estimate,
                prior_sigma=number.sigma,
                updated=estimate.estimate,
                updated_sigma=estimate.sigma,
            )


def _noise_ratio(result: CheckResult) -> float:
    """Return the noise of the checked corners over that of the calibration's, at least 1."""
    return max(1.0, result.statistics.noise_ratio) if result.statistics else 1.0
