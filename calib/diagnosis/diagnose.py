"""From a calibration to a better one: find the residual, name the effect, add it, and say what that
changed on held-out views.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.corners.view import are_timed, board_poses
from calib.diagnosis.diagnosed import with_fit
from calib.diagnosis.families import settle
from calib.diagnosis.finding import Candidate, Diagnosis, Family, ParameterEstimate, Quality
from calib.diagnosis.held_out import FOLDS, bands, folds
from calib.diagnosis.selection import MOST_EFFECTS, TRIED, Loop
from calib.diagnosis.sentences import formulas_of, remarks, unconfirmed_scores, verdict
from calib.diagnosis.starting_model import base_model, model_of
from calib.diagnosis.variance_split import Scene, Share
from calib.effects.effect import Effect
from calib.effects.registry import EFFECTS
from calib.errors import NotEnoughDataError
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.noise import burst_noise, on_board, short_scale_noise
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals, residuals
from calib.fitting.evaluate import evaluate
from calib.fitting.view_noise import VIEW_NOISE, noisier
from calib.progress import Progress, Silent
from calib.session.session import Session
from calib.threads import single_thread

FEWEST_VIEWS = FOLDS
CONFIRMING_VIEWS = 2 * FOLDS
"""With fewer the scores are given, and nothing is accepted."""
ORGANISED = 1e-3
"""p-value from which something is said to organise a residual, over the things that are asked."""
NOTICEABLE = 0.03
"""Of the variance, above chance: less is not worth a word."""


def diagnose(
    calibration: Calibration, progress: Progress = Silent(), holdout: Session | None = None
) -> tuple[Calibration, Diagnosis]:
    """Run the loop.

    Args:
        holdout: views that no fit has seen; without them, held-out errors are those of folds over
            the calibration's own views.

    Returns:
        The calibration with the accepted effects, or an equal one where there are none, and the
        finding.

    Raises:
        NotEnoughDataError: too few views to hold any out, or no fit of them is finite.
    """
    poses = board_poses(calibration.views)
    if (count := len(set(poses.tolist()))) < FEWEST_VIEWS:
        raise NotEnoughDataError(
            f"A diagnosis holds views out in turn and needs {FEWEST_VIEWS} or more, but the"
            f" calibration has {count}: take more pictures."
        )
    observations = calibration.observations
    advance = progress.task("Diagnosis", MOST_EFFECTS + 2 * TRIED)
    with single_thread():
        model = model_of(calibration)
        advance(1, "fit")
        joint = model.fitted(observations, torch.from_numpy(calibration.poses))
        if not joint.finite:
            raise NotEnoughDataError(joint.outcome.value)
        loop = Loop(
            calibration.board,
            calibration.camera,
            observations,
            folds(poses),
            bands(_distances(model, joint, observations), poses),
            base_model(calibration),
            model,
            joint,
            lambda done, words: advance(min(1 + done, MOST_EFFECTS + 2 * TRIED - 1), words),
            lambda model, joint: bool(
                organising_of(
                    split_of(
                        calibration, model, joint, observations, _missed(model, joint, observations)
                    )
                )
            ),
        )
        families: tuple[Family, ...] = ()
        if count < CONFIRMING_VIEWS:
            first = loop.left()
            unconfirmed = unconfirmed_scores(loop.scores(EFFECTS), count, CONFIRMING_VIEWS)
        else:
            first = loop.run()
            advance(MOST_EFFECTS + 2 * TRIED - 1, "rivals")
            families = settle(loop)
            unconfirmed = ()
        last = loop.left()
        advance(MOST_EFFECTS + 2 * TRIED, "")
        before, after = (
            _missed(model, joint, observations),
            _missed(loop.model, loop.joint, observations),
        )
        shares = split_of(calibration, model, joint, observations, before)
        organising = organising_of(
            split_of(calibration, loop.model, loop.joint, observations, after)
        )
        formulas = tuple(formulas_of(loop))
        worse = filter(None, [noisier(calibration.settings.get(VIEW_NOISE, {}))])
        said = (
            *unconfirmed,
            *worse,
            *remarks(loop, families, formulas, organising, timed=are_timed(calibration.views)),
        )
    accepted = tuple(effect.name for effect in loop.model.effects)
    found = with_fit(calibration, loop.model, loop.joint, observations)
    held = first.rms, last.rms
    if holdout:
        base = with_fit(calibration, model, joint, observations)
        halves = loop.model.path.private
        held = (
            evaluate(base, holdout, progress, halves=halves).rms_px,
            evaluate(found, holdout, progress, halves=halves).rms_px,
        )
    grid = on_board(after.image, calibration.views)
    still = burst_noise(grid, poses)
    noise = still if np.isfinite(still) else short_scale_noise(grid, calibration.board)
    finding = Diagnosis(
        noise_px=noise,
        noise_from=(
            "pictures of one pose of the board"
            if np.isfinite(still)
            else "the residual's short-scale part"
        ),
        residual=tuple(shares),
        candidates=tuple(_candidates(loop, accepted)),
        accepted=accepted,
        families=families,
        formulas=formulas,
        before=Quality(before.rms_px, before.rmse_cm, held[0]),
        after=Quality(after.rms_px, after.rmse_cm, held[1]),
        unexplained=_unexplained(after, noise, observations, loop.joint),
        organised_by=organising[0].organised_by if organising else "",
        remarks=said,
    )
    return (
        replace(found, noise_px=noise, settings=found.settings | {"diagnosis": finding.as_json()}),
        finding,
    )


def _distances(
    model: CameraModel, joint: JointFit, observations: Observations
) -> NDArray[np.float64]:
    """(V,) m, of each view's corners on average."""
    timed, view = observations.with_times(joint.values), observations.view.numpy()
    places = model.path.place(observations.corners, timed, joint.poses[observations.view])
    return np.asarray(np.bincount(view, model.path.distance(places).numpy()) / np.bincount(view))


def _missed(model: CameraModel, joint: JointFit, observations: Observations) -> Residuals:
    return residuals(model.path, joint.values, observations, joint.poses)


def split_of(
    calibration: Calibration,
    model: CameraModel,
    joint: JointFit,
    observations: Observations,
    left: Residuals,
) -> list[Share]:
    """What organises the residual of a fit, by how much each explains."""
    missed = left.image
    seen = torch.isfinite(missed).all(-1)
    kept = observations.kept(seen)
    timed = kept.with_times(joint.values)
    places = model.path.place(kept.corners, timed, joint.poses[kept.view])
    rays = model.path.trace(kept.pixels, timed)
    start = model.path.lens(*model.path.adjusted(kept.pixels, timed)).direction
    incidence = start.z if not model.path.cover else start.dot(rays.direction)
    scene = Scene(
        kept,
        missed[seen].numpy(),
        model.path.distance(places).numpy(),
        incidence.numpy(),
        calibration.camera.width,
        calibration.camera.height,
    )
    return scene.split()


def organising_of(shares: Sequence[Share]) -> list[Share]:
    """Those that explain more than noise would."""
    return [
        s
        for s in shares
        if s.p_value < ORGANISED / len(shares) and s.fraction - s.chance > NOTICEABLE
    ]


def _unexplained(
    missed: Residuals, noise: float, observations: Observations, joint: JointFit
) -> float:
    """The fraction of the residual's variance above the noise floor, fitted parameters allowed
    for.
    """
    freedom = max(1, 2 * len(observations.pixels) - joint.poses.numel()) / (
        2 * len(observations.pixels)
    )
    return (
        max(0.0, 1.0 - noise**2 * freedom / missed.rms_px**2)
        if np.isfinite(noise)
        else float("nan")
    )


def _candidates(loop: Loop, accepted: tuple[str, ...]) -> list[Candidate]:
    listed = []
    for (name, shape), trial in loop.trials.items():
        taken = name in accepted and any(
            e.name == name and e.form == shape for e in loop.model.effects
        )
        joint = loop.joint if taken else trial.fit and trial.fit.joint
        effect = (
            next(e for e in loop.model.effects if e.name == name) if taken else trial.test.effect
        )
        listed.append(
            Candidate(
                effect=name,
                form=shape,
                chi2=trial.test.chi2,
                dof=trial.test.dof,
                p_value=trial.test.p_value,
                absorbed=trial.test.absorbed,
                held_out_px_before=trial.gain.before if trial.gain else None,
                held_out_px_after=trial.gain.after if trial.gain else None,
                gain_ci95=trial.gain.ci95 if trial.gain else None,
                parameters=_parameters(effect, joint) if joint and joint.finite else {},
                confounded_with=tuple(sorted(loop.confounded.get(name, ()))),
                accepted=taken,
                verdict=verdict(trial, taken=taken),
                depth_bands_px=(trial.bands.before, trial.bands.after) if trial.bands else None,
            )
        )
    return listed


def _parameters(effect: Effect, joint: JointFit) -> dict[str, ParameterEstimate]:
    """Numbers by themselves; of a field, its root mean square."""
    found = {}
    for unknown in effect.unknowns:
        name, unit = unknown.param.name, unknown.param.unit
        value, sigma = joint.values[name], joint.sigma_of(name)
        if unknown.param.shape:
            name, value, sigma = f"{name}.rms", (value**2).mean().sqrt(), (sigma**2).mean().sqrt()
        found[name] = ParameterEstimate(float(value), float(sigma), unit)
    return found
