"""The joint fit of a camera behind a cover. It decides whether the glass is uneven:

1. Fit even glass. Everything that the numbers of camera and cover explain is explained by them
   first.
2. If what is left shows no texture of the glass, that is the fit.
3. If a bent board explains more than uneven glass would, fit even glass and a bent board, and ask
   again.
4. Else fit uneven glass, starting there.
"""

from __future__ import annotations

import math
from dataclasses import replace

from torch import Tensor

from calib.calibration_content import Stage
from calib.effects.board_shape import DEGREES, BoardShape
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import FIRST_SIGMA, GOOD_GLASS, ROUNDS, JointFit, Start
from calib.estimation.residuals import residuals
from calib.fitting.fit_job import FitJob
from calib.fitting.fitted import COVER_STAGE, Fitted, stage_of
from calib.fitting.seen_glass import covers_seen_glass, seen_relief, with_uneven_glass
from calib.optics.build import covered_path
from calib.optics.relief import AMPLITUDES
from calib.session.cover import AUTO, EVEN

MIN_LOG_ODDS = math.log(100)
"""The least log odds of uneven glass, or of a bent board behind even glass, against less."""


def fit_cover(job: FitJob, poses: Tensor, earlier: Fitted | None) -> Fitted:
    """Return the joint fit of a covered camera.

    Args:
        job: what to fit, with the stages up to the smooth cover.
        poses: (V, 6) of the boards behind the smooth cover.
        earlier: a fit of the same setup and views to other corners, from which this one starts.
            If its glass is uneven, so is that of this one.
    """
    setup = job.setup
    even = job.model(*covered_path(setup.intrinsics, setup.cover))
    start = job.initial(setup.initial_values(even.means))
    if earlier and earlier.joint:
        start = earlier.joint.start
        poses = earlier.poses
    was_uneven = earlier is not None and earlier.relief is not None
    is_known = setup.cover.glass is not None
    if was_uneven or is_known:
        return _fit_uneven(job, even, poses, earlier, start)
    subset, on_averages = job.part, None
    smooth = subset.fit(even, poses, start)
    if job.surface == EVEN or not smooth.finite:
        return job.finish_all(even, smooth)
    log_odds, texture = subset.log_odds_of_texture(even, smooth)
    # With every number held, nothing but the glass could make up for their errors.
    is_asked = job.surface == AUTO and bool(even.priors.sigmas)
    if is_asked and subset is not job and log_odds < MIN_LOG_ODDS:
        # A part of the corners shows no texture: ask all of them.
        subset = job
        smooth, on_averages = job.complete(even, smooth)
        log_odds, texture = job.log_odds_of_texture(even, smooth)
    if is_asked and log_odds < MIN_LOG_ODDS:
        return job.finish(even, smooth, None, on_averages)
    if not job.is_possible(even, smooth):
        # Even glass has no bumps, and its numbers went elsewhere to imitate them.
        return _fit_uneven(job, even, poses, None, start)
    bent = _fit_bent(subset, even, smooth, log_odds) if job.decides_bend else None
    start = replace(smooth.start, smoothness=texture)
    if not (bent and bent.model and bent.joint):
        return _fit_uneven(job, even, smooth.poses, None, start)
    return _fit_behind_bent_board(job, subset, even, start, smooth.poses, bent)


def _fit_bent(job: FitJob, even: CameraModel, smooth: JointFit, log_odds: float) -> Fitted | None:
    """Return the fit of a bent board behind even glass if the bend explains more than uneven glass
    would, and None if not, or if the target is not flat.

    Args:
        smooth: the fit of a flat board behind even glass.
        log_odds: the log odds of uneven glass at that fit.
    """
    if not job.setup.board.is_flat:
        return None
    bent = even.with_effect(BoardShape(*job.setup.board.half, DEGREES[-1]))
    joint = bent.fit(job.observations, smooth.poses, smooth.start, ROUNDS)
    if not joint.log_evidence > smooth.log_evidence + log_odds + MIN_LOG_ODDS:
        return None
    fitted = job.finish(even, smooth)
    return fitted if fitted.effects else None


def _fit_behind_bent_board(
    job: FitJob, subset: FitJob, even: CameraModel, start: Start, poses: Tensor, bent: Fitted
) -> Fitted:
    """Return the fit of a bent board, behind uneven glass if it shows a texture beside the bend.

    Args:
        subset: the job with the corners of `bent`.
        even: the model of a flat board behind even glass.
        start: the start of uneven glass with a flat board.
        poses: (V, 6) of the flat board.
        bent: the fit of a bent board behind even glass.
    """
    assert bent.model
    assert bent.joint
    log_odds, texture = subset.log_odds_of_texture(bent.model, bent.joint)
    if job.surface == AUTO and log_odds < MIN_LOG_ODDS:
        if subset is job:
            return bent
        finished = replace(job, decided=bent).finish_all(bent.model, bent.joint)
        return replace(finished, turned=bent.turned)
    flat = _flat_board_stage(job, subset, even, start, poses)
    job = replace(job, decided=replace(bent, stages=(*job.stages, flat, bent.stages[-1])))
    start = replace(bent.joint.start, smoothness=texture)
    fitted = _fit_uneven(job, bent.model, bent.poses, None, start)
    return replace(fitted, turned=bent.turned)


def _flat_board_stage(
    job: FitJob, subset: FitJob, even: CameraModel, start: Start, poses: Tensor
) -> Stage:
    """Return the error of a flat board behind uneven glass, from a rough fit: the bend removes
    it.
    """
    setup, settings = job.setup, job.settings
    relief = seen_relief(setup, settings, even.path, setup.initial_values(even.means))
    flat = with_uneven_glass(even, relief, setup, settings)
    rough = subset.fit(flat, poses, start, ROUNDS[:1])
    residual = residuals(flat.path, rough.values, subset.observations, rough.poses)
    return stage_of(COVER_STAGE, residual)


def _fit_uneven(
    job: FitJob, even: CameraModel, poses: Tensor, earlier: Fitted | None, start: Start | None
) -> Fitted:
    """Return the fit with a relief. If its numbers move so far that the camera sees other glass,
    the relief moves there, and the fit is repeated.

    Args:
        even: the model without a relief.
        earlier: an earlier fit with a relief, which is kept.
        start: the start, with or without a relief; None with the prior of a known glass.
    """
    setup, settings = job.setup, job.settings
    start = start or Start(even.means, FIRST_SIGMA, GOOD_GLASS)
    if earlier and earlier.relief:
        model = with_uneven_glass(even, earlier.relief, setup, settings)
        return job.finish_all(model, job.part.fit(model, poses, start), earlier.relief)
    relief = seen_relief(setup, settings, even.path, setup.initial_values(even.means))
    model = with_uneven_glass(even, relief, setup, settings)
    subset = job.part
    joint = subset.fit(model, poses, start, ROUNDS[:1])
    for is_last in (False, True):
        start = joint.start
        if not covers_seen_glass(relief, setup, settings, even.path, joint.values):
            relief = seen_relief(setup, settings, even.path, joint.values)
            model = with_uneven_glass(even, relief, setup, settings)
            flat = {AMPLITUDES: model.means[AMPLITUDES]}
            start = replace(start, values={**start.values, **flat})
        elif is_last:
            break
        joint = subset.fit(model, joint.poses, start)
    return job.finish_all(model, joint, relief)
