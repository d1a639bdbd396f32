"""A calibration brought up to date: fitted to the checked views with all that it knew as the prior,
its history kept.

Of a valid calibration the new views tell its numbers better, and are added to its own. Where one
change of the camera or its cover has a name, that change is fitted beside them, and only the new
views go on, for the old ones show the camera as it was.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime

import numpy as np
import torch

from calib.calibration import Calibration
from calib.checking.answer import Answer, Word
from calib.checking.changes import KINDS, changes_of
from calib.checking.cover_spin import CoverSpin
from calib.checking.known import Known
from calib.checking.later_stages import stages_of
from calib.checking.picture_mode import PictureMode
from calib.checking.pictures import Pictures
from calib.checking.refit import Refit, refit
from calib.corners.view import View
from calib.diagnosis.diagnosed import with_fit
from calib.effects.effect import Effect
from calib.errors import InputError, NotEnoughDataError
from calib.estimation.joint_fit import JointFit
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.observations import Observations
from calib.estimation.poses import pinhole_poses, refit_poses
from calib.fitting.declared import comparisons
from calib.optics.relief import AMPLITUDES
from calib.threads import single_thread

UPDATES = "updates"
"""Of a calibration's settings: the checks that it was brought up to date by, the first first."""
KEPT_APART = frozenset({CoverSpin.name, PictureMode.name, "board_scale", "board_shape"})
"""Changes that a calibration cannot carry, or that are none of the camera."""


@dataclass(frozen=True, slots=True)
class Moved:
    """One number of a calibration before and after, in the unit that session.yaml has."""

    name: str
    unit: str
    before: float
    sigma_before: float
    after: float
    sigma_after: float

    @property
    def sigmas(self) -> float:
        """How far it moved, in standard deviations of what it was known to before."""
        return (self.after - self.before) / self.sigma_before if self.sigma_before > 0 else 0.0

    def as_json(self) -> dict[str, object]:
        return {
            "unit": self.unit,
            "before": self.before,
            "sigma_before": self.sigma_before,
            "after": self.after,
            "sigma_after": self.sigma_after,
            "moved_sigmas": self.sigmas,
        }


def update(
    calibration: Calibration, known: Known, answer: Answer, pictures: Pictures
) -> tuple[Calibration, tuple[Moved, ...]]:
    """The calibration after the pictures, and how far each of its numbers moved.

    Raises:
        InputError: the pictures show another board.
        NotEnoughDataError: what changed is nothing that a calibration of this camera can carry, or
            the fit is not finite.
    """
    ours, theirs = calibration.board, pictures.board
    if (ours.columns, ours.rows, ours.square) != (theirs.columns, theirs.rows, theirs.square):
        raise InputError(
            f"--update needs pictures of the calibration's own board, {ours}, not of {theirs}: take"
            " some of it, or fit anew."
        )
    change = _change(answer, calibration, known)
    views = tuple(
        view for view in pictures.views if view.name not in {one.name for one in answer.rejected}
    )
    with single_thread():
        observations = Observations.of(views, pictures.board).add_times(
            None, calibration.camera.height
        )
        poses, _ = known.posed(observations, pinhole_poses(observations, known.model.means))
        fit = refit(known, change, observations, poses, known.sigma * max(1.0, answer.louder))
        if not fit.finite:
            raise NotEnoughDataError(
                "The calibration cannot be brought up to date by these pictures: fit a session of"
                " more views."
            )
        updated = _with(calibration, known, change, fit, views)
    moved = tuple(_moved(calibration, updated))
    said = {
        "calibration_sha256": calibration.digest,
        "finished": datetime.now(UTC).isoformat(timespec="seconds"),
        "answer": answer.word.value,
        "views": [view.name for view in views],
        "change": change.name if change else "",
        "moved_sigmas": {one.name: one.sigmas for one in moved},
    }
    return (
        replace(
            updated,
            settings=updated.settings | {UPDATES: [*calibration.settings.get(UPDATES, []), said]},
        ),
        moved,
    )


def carries(answer: Answer) -> bool:
    """Whether what has changed, if anything, has one name and is something that a calibration can
    carry.
    """
    names = [change.name for change in answer.changes]
    return answer.word is Word.VALID or (
        len(names) == 1 and names[0] in {kind.name for kind in KINDS} - KEPT_APART
    )


def _change(answer: Answer, calibration: Calibration, known: Known) -> Effect | None:
    if not known.parameters.count:
        raise NotEnoughDataError(
            "The calibration does not say how sure it is of its numbers, so few pictures cannot"
            " update it: fit anew."
        )
    if answer.word is Word.VALID:
        return None
    if not carries(answer):
        what = (
            str(answer.changes[0])
            if len(answer.changes) == 1
            else "what has changed has no one name"
        )
        raise NotEnoughDataError(
            f"The calibration cannot be brought up to date ({what}): record a new session and"
            " fit it."
        )
    return next(
        change for change in changes_of(calibration) if change.name == answer.changes[0].name
    )


def _with(
    calibration: Calibration,
    known: Known,
    change: Effect | None,
    fit: Refit,
    views: tuple[View, ...],
) -> Calibration:
    """The calibration with the fit's numbers, and the views that show the camera as it is now."""
    there = {effect.name for effect in known.model.effects}
    model = known.model.with_effects([change] if change and change.name not in there else [])
    poses = fit.poses
    taken = {view.name for view in calibration.views}
    views = tuple(replace(view, name=_free(view.name, taken)) for view in views)
    if not change:
        views = (*calibration.views, *views)
        if calibration.views:  # one that was made for another medium has none
            before = torch.from_numpy(calibration.poses)
            old, _ = refit_poses(
                fit.path, fit.values, calibration.observations, before, sigma=known.sigma
            )
            poses = torch.cat([old, poses])
    joint = JointFit(
        values=fit.values,
        poses=poses,
        covariance=torch.from_numpy(fit.covariance),
        cost=fit.cost,
        sigma=known.sigma,
        smoothness=None,
        parameters=fit.parameters,
        outcome=Outcome.CONVERGED,
        iterations=fit.iterations,
        log_evidence=float("nan"),
        log_marginal=float("nan"),
    )
    base = replace(calibration, views=views)
    found = with_fit(base, model, joint, base.observations)
    order = found.camera_model().parameters  # where a change's numbers stand among the others
    names = [*([AMPLITUDES] if order.relief else []), *(param.name for param in order.free)]
    places = fit.parameters.entries(names)
    found = replace(found, covariance=fit.covariance[np.ix_(places, places)])
    if not calibration.stages:  # its own fit saw no view of this medium
        found = replace(found, stages=stages_of(found))
    kept = {
        key: calibration.settings[key]
        for key in ("relief_prior", "log_evidence")
        if key in calibration.settings
    }
    return replace(found, settings=found.settings | kept)


def _free(name: str, taken: set[str]) -> str:
    """What a view is called that is not of the calibration's own session, which may have a picture
    of the same name.
    """
    name = f"later-{name}"
    return _free(name, taken) if name in taken else name


def _moved(before: Calibration, after: Calibration) -> Iterator[Moved]:
    later = {one.name: one for one in comparisons(after)}
    for one in comparisons(before):
        then = later[one.name]
        if one.sigma > 0:
            yield Moved(one.name, one.unit, one.estimate, one.sigma, then.estimate, then.sigma)
