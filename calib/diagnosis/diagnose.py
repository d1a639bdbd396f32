"""The diagnosis of a calibration: name the missing effects, add them, and report the error on
held-out views before and after.

1. Fit the calibration's model again, without the effects that the fit added by itself.
2. Search for effects that held-out views confirm (`run_search`), and for others that explain the
   views as well (`find_families`).
3. Measure both fits on held-out views.
4. Describe the error that remains: its size above the noise, and its pattern.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration, CalibrationSource
from calib.corners.view import are_timed, pose_labels
from calib.diagnosis.all_free import with_all_free
from calib.diagnosis.backward_elimination import drop_idle
from calib.diagnosis.effect_description import first_changed, spread_of
from calib.diagnosis.equivalence import find_families
from calib.diagnosis.finding import Candidate, Diagnosis, ParameterEstimate
from calib.diagnosis.printed_patterns import ClosedForm
from calib.diagnosis.search import (
    MAX_EFFECTS,
    MAX_FITS,
    run_search,
    score,
    with_free_numbers,
)
from calib.diagnosis.search_state import SearchProblem, SearchState
from calib.diagnosis.sentences import printed_forms, remarks, trial_verdict, unconfirmed_scores
from calib.effects.effect import Effect
from calib.effects.registry import EFFECTS
from calib.errors import NotEnoughDataError
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.noise import (
    burst_noise,
    is_stated_noise,
    on_board_grid,
    short_scale_noise,
    stated_noise,
)
from calib.estimation.observations import Observations
from calib.estimation.residuals import Residuals, residuals
from calib.fit_record.history import DiagnosisRecord, Family, Quality
from calib.fitting.differing import Differing
from calib.fitting.evaluate import Evaluation, evaluate
from calib.fitting.fit_result import with_fit
from calib.fitting.view_noise import describe_noisy_views
from calib.inference.calibration_model import (
    base_model,
    fit_again,
    full_model,
    without_own_bend,
)
from calib.inference.cross_validation import (
    FOLDS,
    MIN_CONFIRMING_VIEWS,
    depth_split,
    fold_split,
)
from calib.inference.fitted_model import ModelFit
from calib.inference.residual_structure import (
    VarianceShare,
    significant_shares,
    variance_shares,
)
from calib.progress import Advance, Progress, Silent, check_progress
from calib.session.session import Session, SessionSource
from calib.threads import single_thread

MIN_POSES = FOLDS
"""The number of poses of the board that a diagnosis needs."""
STEPS = MAX_EFFECTS + 2 * MAX_FITS
"""The length of the progress bar."""


def diagnose(
    calibration: CalibrationSource,
    progress: Progress = Silent(),
    holdout: SessionSource | None = None,
) -> tuple[Calibration, Diagnosis]:
    """Diagnose a calibration.

    Args:
        calibration: the calibration, or the path of its file or folder.
        holdout: a session, or the path of its folder, with views that no fit has seen; without
            them, held-out errors are those of folds over the calibration's own views.

    Returns:
        The calibration with the accepted effects, or an equal one without any, and the diagnosis.

    Raises:
        NotEnoughDataError: there are too few views to hold any out, or the fit is not finite.
    """
    check_progress(progress)
    calibration = Calibration.of(calibration)
    holdout = None if holdout is None else Session.of(holdout)
    pose_count = _count_poses(calibration)
    observations = calibration.observations
    advance = progress.task("Diagnosis", STEPS)
    with single_thread():
        with_free = with_all_free(calibration)
        start = _begin(calibration, with_free, _Reporter(advance))
        base = start.fit
        base_held_out = start.evaluations.held_out_errors().rms
        result = _search(start, calibration, advance)
        state = result.state
        held_out = state.evaluations.held_out_errors().rms
        advance(STEPS, "")
        formulas = tuple(printed_forms(state))
        structure = significant_shares(_shares(calibration, state.fit, observations))
        sentences = _sentences(result, calibration, formulas, structure)
    extended = _with_result(calibration, with_free, state)
    on_holdout: _HoldoutErrors | None = None
    if holdout:
        refitted = with_fit(calibration, base.model, base.joint, observations)
        on_holdout = _HoldoutErrors.of(calibration, refitted, extended, holdout, progress)
        base_held_out, held_out = on_holdout.refitted.rms_px, on_holdout.extended.rms_px
    base_residuals = _residuals(base, observations)
    residuals_left = _residuals(state.fit, observations)
    noise, noise_source = _noise(calibration, residuals_left, pose_labels(calibration.views))
    accepted = tuple(effect.name for effect in state.model.effects)
    diagnosis = Diagnosis(
        noise_px=noise,
        noise_from=noise_source,
        residual=tuple(_shares(calibration, base, observations)),
        candidates=tuple(_candidates(state, accepted)),
        accepted=accepted,
        earlier=tuple(effect.name for effect in base.model.effects if effect.name in accepted),
        families=result.families,
        formulas=formulas,
        differing=result.differing,
        given_held_out_px=on_holdout.initial.rms_px if on_holdout else None,
        given=calibration.stages[-1] if calibration.stages else None,
        decided=pose_count >= MIN_CONFIRMING_VIEWS,
        evaluation=on_holdout.extended if on_holdout else None,
        base_quality=Quality(base_residuals.rms_px, base_residuals.rmse_cm, base_held_out),
        final_quality=Quality(residuals_left.rms_px, residuals_left.rmse_cm, held_out),
        unexplained=_unexplained(residuals_left, noise, observations, state.joint),
        organised_by=structure[0].organised_by if structure else "",
        remarks=sentences,
    )
    history = replace(extended.history, diagnosis=DiagnosisRecord(diagnosis.as_json()))
    return replace(extended, noise_px=noise, history=history), diagnosis


def _count_poses(calibration: Calibration) -> int:
    """Return the number of poses of the board.

    Raises:
        NotEnoughDataError: they are too few for a diagnosis.
    """
    count = len(set(pose_labels(calibration.views).tolist()))
    if count < MIN_POSES:
        raise NotEnoughDataError(
            f"A diagnosis holds views out in turn and needs {MIN_POSES} or more, but the"
            f" calibration has {count}: take more pictures."
        )
    return count


def _with_result(
    calibration: Calibration, with_free: Calibration, state: SearchState
) -> Calibration:
    """Return the calibration with the fit after the search. If nothing was added, every number
    stays as it was given.

    Args:
        with_free: the calibration with every number estimated.
    """
    estimates_others = _names(state.model) != _names(state.problem.base)
    if not (state.model.effects or calibration.effects or estimates_others):
        return calibration
    # If the search went over to estimating the held numbers, its problem has no `free_base`.
    fitted_from = calibration if state.problem.free_base else with_free
    return with_fit(fitted_from, state.model, state.joint, calibration.observations)


@dataclass(frozen=True, slots=True)
class _HoldoutErrors:
    """The evaluations of a session with other views."""

    initial: Evaluation
    """With the calibration that is diagnosed."""
    refitted: Evaluation
    """With the fit before the search."""
    extended: Evaluation
    """With the fit after it."""

    @staticmethod
    def of(
        initial: Calibration,
        refitted: Calibration,
        extended: Calibration,
        holdout: Session,
        progress: Progress,
    ) -> _HoldoutErrors:
        """Evaluate the three calibrations. If each view has numbers of its own after the search,
        they come from one half of its corners, and the error is measured on the other half; then
        the halves change places.
        """
        halves = extended.model()[0].has_private_blocks
        return _HoldoutErrors(
            evaluate(initial, holdout, progress),
            evaluate(refitted, holdout, progress, halves=halves),
            evaluate(extended, holdout, progress, halves=halves),
        )


def _begin(
    calibration: Calibration, with_free: Calibration, report: Callable[[str], None]
) -> SearchState:
    """Return the state before the search: a fit of the calibration's model. If the fit of the
    session added a bend or a stretched print of the board, it is left out here, because held-out
    views have to confirm every cause.

    Args:
        with_free: the calibration with every number estimated.
        report: called with what the search does next.

    Raises:
        NotEnoughDataError: the fit is not finite.
    """
    observations = calibration.observations
    model = full_model(without_own_bend(calibration))
    report("fit")
    base = ModelFit(model, fit_again(calibration, model))
    if not base.joint.finite:
        raise NotEnoughDataError(base.joint.outcome.value)
    poses = pose_labels(calibration.views)
    problem = SearchProblem(
        board=calibration.board,
        camera=calibration.camera,
        observations=observations,
        folds=fold_split(poses),
        depth_bands=depth_split(_view_distances(base, observations), poses),
        base=base_model(calibration),
        free_base=base_model(with_free) if with_free is not calibration else None,
        report=report,
        has_structure=lambda fit: bool(significant_shares(_shares(calibration, fit, observations))),
    )
    return SearchState.begin(problem, base)


@dataclass(frozen=True, slots=True)
class _SearchResult:
    """The result of a search."""

    state: SearchState
    families: tuple[Family, ...] = ()
    differing: Differing | None = None
    scores: tuple[str, ...] = ()
    """Sentences about the scores of effects that too few views confirm."""


def _search(state: SearchState, calibration: Calibration, advance: Advance) -> _SearchResult:
    """Search for the missing effects, and for others that explain the views as well."""
    count = len(set(pose_labels(calibration.views).tolist()))
    if count < MIN_CONFIRMING_VIEWS:
        state, tests = score(state, EFFECTS)
        return _SearchResult(state, scores=unconfirmed_scores(tests, count, MIN_CONFIRMING_VIEWS))
    state = run_search(state)
    advance(STEPS - 1, "rivals")
    state, families = find_families(state)
    if (free := with_free_numbers(state)) is not state:
        state, families = find_families(drop_idle(free)[0])
    left_px = _residuals(state.fit, calibration.observations).rms_px
    if is_stated_noise(calibration.board, left_px, stated_noise(calibration.views)):
        return _SearchResult(state, families)
    return _SearchResult(state, families, state.evaluations.differing)


def _sentences(
    result: _SearchResult,
    calibration: Calibration,
    formulas: Sequence[ClosedForm],
    structure: Sequence[VarianceShare],
) -> tuple[str, ...]:
    """Return the remarks of a diagnosis."""
    noisy_views = describe_noisy_views(calibration.outcome.view_noise)
    differing = str(result.differing or "")
    timed = are_timed(calibration.views)
    return (
        *result.scores,
        *([noisy_views] if noisy_views else []),
        *([f"{differing[0].upper()}{differing[1:]}"] if differing else []),
        *remarks(result.state, result.families, formulas, structure, timed=timed),
    )


class _Reporter:
    """Progress of a search whose number of steps is not known beforehand."""

    def __init__(self, advance: Advance) -> None:
        self._advance = advance
        self._steps = 0

    def __call__(self, remark: str) -> None:
        self._steps += 1
        self._advance(min(self._steps, STEPS - 1), remark)


def _names(model: CameraModel) -> list[str]:
    """Return the names of the numbers that a fit of the model estimates."""
    return [param.name for param in model.parameters.free]


def _view_distances(fit: ModelFit, observations: Observations) -> NDArray[np.float64]:
    """Return (V,) m, the mean distance of the corners of each view (`Path.distance`)."""
    poses = fit.joint.poses[observations.view]
    points = fit.model.path.place(
        observations.corners, fit.joint.values, poses, observations.exposure
    )
    distance = fit.model.path.distance(points).numpy()
    view = observations.view.numpy()
    return np.asarray(np.bincount(view, distance) / np.bincount(view))


def _residuals(fit: ModelFit, observations: Observations) -> Residuals:
    return residuals(fit.model.path, fit.joint.values, observations, fit.joint.poses)


def _shares(
    calibration: Calibration, fit: ModelFit, observations: Observations
) -> list[VarianceShare]:
    """Return the structure of the residual of a fit."""
    return variance_shares(
        calibration, fit.model, fit.joint, observations, _residuals(fit, observations)
    )


def _noise(
    calibration: Calibration, residual: Residuals, poses: NDArray[np.int64]
) -> tuple[float | None, str]:
    """Return the noise floor in px, None if it is unknown, and its source in words."""
    grid = on_board_grid(residual.image, calibration.views)
    noise = burst_noise(grid, poses)
    if noise is not None:
        return noise, "pictures of one pose of the board"
    if not calibration.board.has_grid:
        return stated_noise(calibration.views), "the points' covariances"
    return short_scale_noise(grid, calibration.board), "the residual's short-scale part"


def _unexplained(
    residual: Residuals, noise: float | None, observations: Observations, joint: JointFit
) -> float | None:
    """Return the fraction of the residual's variance above the noise floor, corrected for the
    degrees of freedom; None if the noise is unknown.
    """
    if noise is None:
        return None
    count = 2 * len(observations.pixels)
    freedom = max(1, count - joint.poses.numel()) / count
    return max(0.0, 1.0 - noise**2 * freedom / residual.rms_px**2)


def _candidates(state: SearchState, accepted: tuple[str, ...]) -> list[Candidate]:
    """Return every trial of the search as a candidate of the diagnosis: the accepted ones first, in
    the order in which they were added.
    """
    effects = {effect.name: effect for effect in state.model.effects}
    candidates = []
    for (name, form), trial in state.trials.items():
        is_accepted = name in accepted and effects[name].form == form
        fit = state.fit if is_accepted else trial.fit
        effect = effects[name] if is_accepted else trial.test.effect
        gain = trial.gain
        bands = trial.depth_gain
        candidates.append(
            Candidate(
                effect=name,
                form=form,
                chi2=trial.test.chi2,
                dof=trial.test.dof,
                p_value=trial.test.p_value,
                absorbed=trial.test.absorbed,
                held_out_px_before=gain.base_px if gain else None,
                held_out_px_after=gain.extended_px if gain else None,
                gain_ci95=gain.ci95 if gain else None,
                parameters=_estimates(effect, fit.joint) if fit and fit.joint.finite else {},
                confounded_with=tuple(sorted(state.confounded.get(name, ()))),
                accepted=is_accepted,
                verdict=trial_verdict(trial, accepted=is_accepted),
                varies=effect.varies or None,
                spread=spread_of(effect, fit) if fit and fit.joint.finite else {},
                from_file=first_changed(effect, state.problem.observations.names),
                depth_bands_px=(bands.base_px, bands.extended_px) if bands else None,
            )
        )
    order = {name: place for place, name in enumerate(accepted)}
    candidates.sort(key=lambda c: order[c.effect] if c.accepted else len(order))
    return candidates


def _estimates(effect: Effect, joint: JointFit) -> dict[str, ParameterEstimate]:
    """Return the estimate of each scalar parameter, and the root mean square of each field."""
    estimates = {}
    for unknown in effect.effect_parameters:
        name = unknown.param.name
        value = joint.values[name]
        sigma = joint.sigma_of(name)
        if unknown.param.shape:
            name = f"{name}.rms"
            value = (value**2).mean().sqrt()
            sigma = (sigma**2).mean().sqrt()
        estimates[name] = ParameterEstimate(float(value), float(sigma), unknown.param.unit)
    return estimates
