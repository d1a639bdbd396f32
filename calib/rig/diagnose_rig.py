"""The diagnosis of a rig: why its cameras disagree on where the board is, and whether the board
bends differently in every placement.

In each round, every explanation gets its evidence from the linearised fit. The most probable one is
added to the fit if its odds against no cause are more than chance, and if the error on held-out
placements falls. What these placements cannot tell from it is said.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from calib.diagnosis.trial import ALPHA, is_worthwhile
from calib.effects.varying import FROM_VIEW
from calib.errors import NotEnoughDataError
from calib.estimation.residuals import Residuals, residuals
from calib.fit_record.history import Family
from calib.inference.cross_validation import HeldOutGain
from calib.progress import Progress, Silent, check_progress
from calib.rig.board_flex_fit import BentFit, fit_with_bends
from calib.rig.explanation_fit import Evaluator, FittedExplanation
from calib.rig.explanations import RigExplanation, explanations
from calib.rig.held_out_placements import MIN_SHARED, held_out_squares, placement_gain
from calib.rig.joint_estimate import RigState
from calib.rig.motion_evidence import FixedEstimate, RandomMotion, ReducedMotions, realign
from calib.rig.rig import Rig, RigCalibrationSource
from calib.rig.rig_candidates import ACCEPTED, candidate_of, families_of
from calib.rig.rig_content import FoundEffect, RigRecord
from calib.rig.rig_context import RigContext, rig_context, times_of
from calib.rig.rig_effects import BOARD_FLEX, RIG_SLIP, ROLLING_SHUTTER
from calib.rig.rig_finding import RigCandidate, RigDiagnosis, RigQuality
from calib.rig.rig_motion_fit import JointNumbers, fit_with_motion, stepped
from calib.rig.rig_result import rig_of, state_of
from calib.rig.rig_sentences import (
    bend_parameters,
    describe_found,
    describe_lateness,
    describe_own,
    is_undetermined,
    open_questions,
    parameters_of,
)
from calib.rig.scatter import count_placements
from calib.threads import single_thread

MAX_EFFECTS = 3
"""The largest number of effects of a rig."""

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """The state of the search."""

    state: RigState
    context: RigContext
    found: tuple[FoundEffect, ...] = ()
    fits: tuple[FittedExplanation, ...] = ()
    """The fit of each effect in `found`."""
    sentences: tuple[str, ...] = ()
    families: tuple[Family, ...] = ()
    candidates: dict[tuple[str, str, str], RigCandidate] = field(default_factory=dict)
    rounds: tuple[tuple[FittedExplanation, ...], ...] = ()
    bent: BentFit | None = None
    """The fit with a bend of the board in each placement, if that was found."""


def diagnose_rig(
    rig: RigCalibrationSource, progress: Progress = Silent()
) -> tuple[Rig, RigDiagnosis]:
    """Diagnose a rig.

    Args:
        rig: the calibrated rig, or the path of its folder.
        progress: the progress bars.

    Returns:
        The rig with the accepted effects in its fit, or the same without any, and the diagnosis.

    Raises:
        WrongTypeError: an argument is of another type.
        NotEnoughDataError: too few placements were seen by two cameras.
    """
    check_progress(progress)
    calibrated = Rig.of(rig)
    advance = progress.task("Diagnosis of the rig", 2 + 2 * MAX_EFFECTS)
    with single_thread():
        state = state_of(calibrated)
        if (count := int((calibrated.cameras_seeing > 1).sum())) < MIN_SHARED:
            raise NotEnoughDataError(
                f"A diagnosis holds placements out in turn and needs {MIN_SHARED} or more that two"
                f" cameras saw, but the rig has {count}: take more pictures of the board where the"
                " views overlap."
            )
        times = times_of(calibrated, len(state.placements))
        search = _Search(state, rig_context(calibrated, state, times))
        advance(1, "")
        none = Evaluator(search.context).fit(RigExplanation(None))
        first_quality = _quality(search, none)
        for number in range(MAX_EFFECTS):
            advance(2 + 2 * number, "explanations")
            search, is_found = _round(calibrated, search, times)
            if not is_found:
                break
        none = Evaluator(search.context).fit(RigExplanation(None))
        last_quality = _quality(search, none)
        better = _with_effects(calibrated, search, none) if search.found else calibrated
        advance(2 + 2 * MAX_EFFECTS, "")
    motion = search.context.motion
    diagnosis = RigDiagnosis(
        candidates=tuple(sorted(search.candidates.values(), key=_rank)),
        found=search.found,
        families=search.families,
        before=first_quality,
        after=last_quality,
        placements=count,
        bursts=len(motion.bursts),
        speed_m_s=motion.speeds[1] if motion.bursts else None,
        remarks=(
            *search.sentences,
            *_latenesses(search),
            *open_questions(search.context),
        ),
    )
    return better, diagnosis


def _rank(candidate: RigCandidate) -> tuple[bool, float]:
    return not candidate.accepted, -candidate.log_odds


def _round(rig: Rig, search: _Search, times: Array) -> tuple[_Search, bool]:
    """Add the most probable effect if held-out placements confirm it."""
    context = search.context
    noise_px = _noise(search.state)
    fits = _fit_all(Evaluator(context), search)
    none, *fits_of_effects = fits
    if not fits_of_effects:
        return search, False
    fits_of_effects.sort(key=lambda fitted: -fitted.log_evidence)
    min_log_odds = none.log_evidence + math.log(len(fits_of_effects) / ALPHA)
    gains: dict[int, HeldOutGain] = {}
    best: FittedExplanation | None = None
    base = held_out_squares(context, none, noise_px)
    for index, fitted in enumerate(fits_of_effects):
        if fitted.log_evidence <= min_log_odds or best:
            break
        wide = context.with_own_effects() if fitted.explanation.own_effect else context
        gain = placement_gain(base, held_out_squares(wide, fitted, noise_px))
        gains[index] = gain
        if gain.ci95[0] > 0 and gain.p_value < ALPHA and is_worthwhile(gain):
            best = fitted
    candidates = dict(search.candidates)
    for index, fitted in enumerate(fits_of_effects):
        is_own = fitted.explanation.own_effect is not None
        is_probable = fitted.log_evidence > min_log_odds
        if is_own and not is_probable:
            continue
        if fitted is best:
            verdict = ACCEPTED if not is_own else "most probable"
        elif not is_probable:
            verdict = "no more than chance"
        elif index in gains:
            verdict = "held-out placements do not confirm it"
        else:
            assert best
            verdict = f"less probable than {best.explanation.name}"
        log_odds = fitted.log_evidence - none.log_evidence
        candidate = candidate_of(rig, fitted, log_odds, gains.get(index), verdict)
        key = _key(fitted.explanation)
        previous = candidates.get(key)
        if previous is None or candidate.accepted or not previous.accepted:
            candidates[key] = candidate
    search = replace(search, candidates=candidates, rounds=(*search.rounds, fits))
    if best is None:
        return search, False
    if best.explanation.own_effect:
        sentence = describe_own(best, best.explanation.camera or rig.reference)
        return replace(search, sentences=(sentence,)), False
    rivals = fits_of_effects[fits_of_effects.index(best) :]
    search = _accept(rig, search, best, rivals, times)
    for fitted, effect in zip(search.fits, search.found, strict=True):
        key = _key(fitted.explanation)
        candidates[key] = replace(candidates[key], parameters=effect.parameters)
    return replace(search, candidates=candidates), True


def _fit_all(evaluator: Evaluator, search: _Search) -> tuple[FittedExplanation, ...]:
    """Return the fits of no cause and of all explanations but those that were found. Of the slips
    of each camera, and of the effects of cameras and the board, the most probable one stands for
    all. After a lateness of unknown size, no motion during a readout is asked: what the lateness
    leaves is a motion of the board, too.
    """
    keys = {(effect.effect, effect.camera, effect.varies) for effect in search.found}
    is_unknown_motion = any(map(is_undetermined, search.fits))
    fits = []
    slips: dict[str, list[RigExplanation]] = {}
    own_effects = []
    for explanation in explanations(evaluator.context):
        if explanation.effect is ROLLING_SHUTTER and is_unknown_motion:
            continue
        if explanation.effect is RIG_SLIP:
            slips.setdefault(explanation.camera, []).append(explanation)
        elif explanation.own_effect:
            own_effects.append(explanation)
        elif _key(explanation) not in keys:
            fits.append(evaluator.fit(explanation))
    fits += [
        evaluator.best_of(candidates)
        for candidates in slips.values()
        if _key(candidates[0]) not in keys
    ]
    if own_effects:
        fits.append(Evaluator(evaluator.context.with_own_effects()).best_of(own_effects))
    return tuple(fits)


def _accept(
    rig: Rig,
    search: _Search,
    best: FittedExplanation,
    fits_of_effects: Sequence[FittedExplanation],
    times: Array,
) -> _Search:
    """Add an explanation to the fit."""
    context = search.context
    state = search.state
    fits = search.fits
    bent = search.bent
    if best.explanation.is_of_bends:
        assert context.board_flex
        bent = fit_with_bends(state, best, context.board_flex)
        state = bent.estimate.state
        later = rig_context(rig, state, times)
        accepted = realign(context.accepted, context.products, later.products)
        context = replace(later, accepted=accepted)
        fits = (*fits, best)
    elif best.fixed:
        state, context, best, numbers = fit_with_motion(rig, state, times, context, best)
        fits = _with_numbers((*fits, best), numbers)
    else:
        context = replace(context, accepted=(*context.accepted, *best.random))
        fits = (*fits, best)
    return replace(
        search,
        state=state,
        context=context,
        found=tuple(_found_effect(rig, state, fitted, fits) for fitted in fits),
        fits=fits,
        bent=bent,
        families=(*search.families, *families_of(best.explanation, fits_of_effects)),
    )


def _found_effect(
    rig: Rig, state: RigState, fitted: FittedExplanation, fits: Sequence[FittedExplanation]
) -> FoundEffect:
    explanation = fitted.explanation
    is_of_bends = explanation.is_of_bends
    effect = FoundEffect(
        explanation.name,
        explanation.camera,
        explanation.varies,
        rig.placement_names[explanation.placement] if explanation.varies == FROM_VIEW else "",
        bend_parameters(state.placements[:, 6:].numpy()) if is_of_bends else parameters_of(fitted),
    )
    return replace(effect, sentence=describe_found(effect, fitted, _partner(rig, fitted, fits)))


def _with_numbers(
    fits: Sequence[FittedExplanation], numbers: JointNumbers
) -> tuple[FittedExplanation, ...]:
    """Return the fits with the numbers of one joint fit: a further effect changes the numbers of
    those before it.
    """
    first = 0
    updated = []
    for fitted in fits:
        if fitted.fixed and fitted.estimate:
            entries = slice(first, first + len(fitted.estimate.value))
            first = entries.stop
            estimate = FixedEstimate(
                fitted.estimate.log_evidence,
                numbers.value[entries],
                numbers.covariance[entries, entries],
            )
            fitted = replace(fitted, estimate=estimate)
        updated.append(fitted)
    return tuple(updated)


def _latenesses(search: _Search) -> list[str]:
    """Return sentences on latenesses that were not found, from the last round. Of the last camera
    in time there is none: the others are late against it.
    """
    if len(_late_cameras(search.fits)) + 1 >= len(search.state.cameras):
        return []
    names = {(effect.effect, effect.camera) for effect in search.found}
    return [
        describe_lateness(fitted)
        for fitted in search.rounds[-1]
        if fitted.explanation.is_late
        and (fitted.explanation.name, fitted.explanation.camera) not in names
    ]


def _key(explanation: RigExplanation) -> tuple[str, str, str]:
    return explanation.name, explanation.camera, explanation.varies


def _partner(rig: Rig, fitted: FittedExplanation, fits: Sequence[FittedExplanation]) -> str:
    """Return the one camera against which an effect is stated; empty for several."""
    if not fitted.explanation.is_late:
        return rig.reference if len(rig.names) == 2 else ""
    late = _late_cameras(fits)
    in_time = [name for name in rig.names if name not in late]
    return in_time[0] if len(in_time) == 1 else ""


def _late_cameras(fits: Sequence[FittedExplanation]) -> set[str]:
    return {fitted.explanation.camera for fitted in fits if fitted.explanation.is_late}


def _quality(search: _Search, none: FittedExplanation) -> RigQuality:
    image = []
    for index, camera in enumerate(search.state.cameras):
        poses = search.state.poses(index)
        image.append(residuals(camera.model.path, camera.values, camera.observations, poses).image)
    joined = torch.cat(image)
    squares = held_out_squares(search.context, none, _noise(search.state))
    held_out = float(np.sqrt(np.nanmean(squares)))
    return RigQuality(Residuals(joined, joined).rms_px, held_out)


def _noise(state: RigState) -> float:
    """Return the noise of a corner, px per axis."""
    return float(np.sqrt(np.mean([camera.sigma**2 for camera in state.cameras])))


def _with_effects(rig: Rig, search: _Search, none: FittedExplanation) -> Rig:
    """Return the rig whose numbers are the most probable ones beside the effects."""
    earlier = tuple(e for e in rig.record.effects if e.effect == BOARD_FLEX.name)
    record = replace(rig.record, effects=(*earlier, *search.found))
    if search.bent:
        record = replace(record, alone_px=search.bent.alone_px)
    if search.bent and len(search.fits) == 1:
        board = rig.calibrations[rig.reference].board
        estimate, scatter = count_placements(search.bent.estimate, board)
        return _rig(rig, estimate.state, estimate.covariance, replace(record, scatter=scatter))
    random: tuple[RandomMotion, ...] = (*search.context.accepted, *none.discrepancy)
    reduced = ReducedMotions.of(search.context.products, random)
    independent = ReducedMotions.of(search.context.products)
    state = stepped(search.state, torch.from_numpy(reduced.step()))
    ratio = reduced.hessian_inverse.diagonal() / independent.hessian_inverse.diagonal()
    record = replace(record, scatter=float(np.sqrt(np.mean(ratio))))
    return _rig(rig, state, torch.from_numpy(reduced.hessian_inverse), record)


def _rig(rig: Rig, state: RigState, covariance: Tensor, record: RigRecord) -> Rig:
    """Return the rig of another state of its fit."""
    return rig_of(
        state,
        covariance,
        rig.calibrations,
        rig.reference,
        rig.covers,
        rig.placement_names,
        record,
    )
