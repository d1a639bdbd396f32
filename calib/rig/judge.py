"""Whether to trust a rig, why not, and what to do next: the reasons of its cameras, and its own."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import chdtri

from calib.corners.copies import count_fitted
from calib.estimation.levenberg_marquardt import Outcome
from calib.estimation.prior_conflict import CONFLICT_THRESHOLD
from calib.io.shell import shell_path
from calib.rig.evaluate_rig import RigEvaluation
from calib.rig.held_out_placements import MIN_SHARED as MIN_DIAGNOSED
from calib.rig.left_out_views import describe_left_out
from calib.rig.rig import Rig
from calib.rig.rig_content import Baseline
from calib.rig.rig_effects import RIG_FLEX, RIG_SLIP, SYNC_OFFSET
from calib.rounding import with_sigma
from calib.session.deviation import independent_deviation
from calib.verdict.judge import judge
from calib.verdict.next_commands import HOLDOUT, held_out_folder
from calib.verdict.thresholds import HELD_OUT_ELSEWHERE, MIN_ELSEWHERE
from calib.verdict.verdict import Reason, Trust, Verdict, uncapitalised

MIN_SHARED = 6
"""The fewest placements that a camera shares with others: its mounting has six numbers, and each
placement that is shared by chance at a bad moment must be one of several.
"""
MAX_GROWTH = 1.25
"""The largest error of a camera in the rig over that of its own fit. Sharing a pose costs a camera
six numbers a view, a few per cent of hundreds of corners; more, and the cameras did not see the
board at the same place.
"""
MAX_BASELINE_SIGMA = 0.02
"""The largest relative standard deviation of a baseline: depths have at least the same."""
SAME_PLACE_SIGMAS = 3.0
"""Standard deviations up to which two cameras are not apart, or not turned."""
SAME_PLACE = 0.002
"""m: the farthest that two cameras which stand at one place may be from each other. No two lenses
fit into it; a wider distance is one that the pictures do not tell.
"""
MAX_HELD_OUT = 1.5
"""The largest error on held-out placements over that of the fit."""
MAX_NORMALISED = 2.0
"""The largest root mean square of held-out lengths' errors over their sigma."""
LENGTHS_CHANCE = 1e-3
"""The chance of a larger one in a rig as sure as it says. Lengths on one placement of the board err
together, because the cameras see it too near or too far: they count as one.
"""

MENDING = {
    RIG_FLEX.name: "tighten the mounting, and record again",
    RIG_SLIP.name: "the rig is as after that; check it before you measure",
}
"""Advice on the effects of a rig that the user has to mend."""
RETIME = (
    "first correct time_s in frames.csv to the true times, write together: {tolerance_ms: 5} in"
    " rig.yaml, and fit the rig again"
)
"""Advice on a delay whose size is not determined."""


@dataclass(frozen=True, slots=True, eq=False)
class RigCase:
    """A rig to judge."""

    rig: Rig
    folder: Path
    """The rig's folder in the commands."""
    source: Path
    """The rig.yaml in the commands."""
    evaluation: RigEvaluation | None

    @property
    def fit_command(self) -> str:
        source = shell_path(self.source)
        # The folder of a diagnosed rig is that of the diagnosis.
        is_diagnosed = bool(self.rig.record.effects)
        folder = self.source.parent / "calibration" if is_diagnosed else self.folder
        return f"calib rig fit {source} -o {shell_path(folder)}"

    @property
    def diagnosis_command(self) -> str:
        """The diagnosis of the rig; empty where there was one, or with too few placements."""
        is_diagnosable = np.sum(self.rig.cameras_seeing > 1) >= MIN_DIAGNOSED
        if self.rig.record.effects or not is_diagnosable:
            return ""
        return f"calib rig diagnose {shell_path(self.folder)}"


RigCheck = Callable[[RigCase], Iterable[Reason]]


def judge_rig(
    rig: Rig,
    *,
    folder: Path | None = None,
    evaluation: RigEvaluation | None = None,
) -> Verdict:
    """Judge whether to trust a rig.

    Args:
        folder: the rig's folder in the commands; by default the name of rig.yaml's folder.
        evaluation: the errors on held-out placements.
    """
    source = Path(rig.record.source or "RIG")
    case = RigCase(rig, folder or source.parent / "calibration", source, evaluation)
    reasons = tuple(reason for check in RIG_CHECKS for reason in check(case))
    place = shell_path(case.folder)
    held_out = None if evaluation else held_out_folder([source.parent])
    command = f"calib rig evaluate {place} {shell_path(held_out) if held_out else HOLDOUT}"
    if evaluation and evaluation.lengths:
        band = evaluation.lengths[len(evaluation.lengths) // 2]
        depth = (band.from_m + band.to_m) / 2
        maps = shell_path(case.folder / "maps")
        command = f"calib rig rectify {place} --depth {depth:.2g} -o {maps}"
    return Verdict(reasons, command)


def rig_not_converged(case: RigCase) -> Iterator[Reason]:
    """Yield a reason if the joint estimate did not end at an optimum."""
    if not case.rig.covariance.size:
        sentence = uncapitalised(Outcome.NOT_FINITE.value)
        yield Reason(sentence, case.fit_command, word=Trust.DO_NOT_USE)
    elif case.rig.record.outcome != Outcome.CONVERGED.value:
        yield Reason(uncapitalised(case.rig.record.outcome), case.fit_command)


def few_shared(case: RigCase) -> Iterator[Reason]:
    """Yield a reason for each camera that shares few placements with the others."""
    rig = case.rig
    seeing = rig.cameras_seeing
    for name, places in rig.of_views.items():
        shared = int((seeing[np.unique(places)] > 1).sum())
        if len(rig.names) > 1 and shared < MIN_SHARED:
            yield Reason(
                f"{name} sees the board in only {shared} placements together with another camera,"
                " so its mounting rests on these: add pictures of the board where their views"
                " overlap.",
                case.fit_command,
            )


def contradicted_baseline(case: RigCase) -> Iterator[Reason]:
    """Yield a reason if the pictures contradict the distance that rig.yaml states, which the
    estimate then does not use.
    """
    number = case.rig.record.baseline
    if not number or not case.rig.covariance.size:
        return
    (baseline,) = case.rig.baselines  # only a pair may state one
    distance = baseline.metres - number.value
    if abs(independent_deviation(distance, number.sigma, baseline.sigma)) <= CONFLICT_THRESHOLD:
        return
    estimated = with_sigma(1000 * baseline.metres, 1000 * baseline.sigma)
    yield Reason(
        f"the distance from {baseline.first} to {baseline.second} is {estimated} mm by the pictures"
        f" alone, and rig.yaml says {with_sigma(1000 * number.value, 1000 * number.sigma)}"
        " mm: measure it again, from pinhole to pinhole, and measure a square of the board, which"
        " the scale comes from.",
        case.fit_command,
    )


def disagreement(case: RigCase) -> Iterator[Reason]:
    """Yield a reason for each camera whose error grows where the cameras share the board's pose."""
    cause = "the board moved between their pictures, or a camera moved in the rig"
    advice, command = "hold the board still, and record again", case.fit_command
    if case.rig.record.effects:
        cause = "the causes that were found do not explain all of it"
    elif case.diagnosis_command:
        advice = "the diagnosis tells which"
        command = case.diagnosis_command
    for name, calibration in case.rig.calibrations.items():
        error = calibration.stages[-1].rms_px
        alone = case.rig.record.alone_px.get(name, error)
        if len(case.rig.names) > 1 and error > MAX_GROWTH * alone:
            yield Reason(
                f"the error of {name} is {error:.3g} px with one pose of the board for all cameras,"
                f" and {alone:.3g} px alone: {cause}: {advice}.",
                command,
            )


def left_out_pictures(case: RigCase) -> Iterator[Reason]:
    """Yield a reason if a camera seems to have slipped, or many pictures contradict the rig."""
    for sentence in describe_left_out(case.rig):
        yield Reason(sentence, _new_recording(case))


def found_effects(case: RigCase) -> Iterator[Reason]:
    """Yield a reason for each effect of the rig that a diagnosis found and that no number of the
    rig describes: a mounting that is not the same in all placements, or a delay of unknown size.
    """
    for effect in case.rig.record.effects:
        if effect.effect in MENDING:
            yield Reason(f"{effect.sentence}: {MENDING[effect.effect]}.", case.fit_command)
        late = effect.parameters.get(f"{SYNC_OFFSET.name}.late")
        if late and late.sigma >= abs(late.value):
            yield Reason(f"{effect.sentence}: {RETIME}.", case.fit_command)


def same_camera(case: RigCase) -> Iterator[Reason]:
    """Yield a reason for each pair of cameras that have the same pictures, or that stand at the
    same place.
    """
    for baseline in case.rig.baselines:
        if sentence := _describe_same_camera(case.rig, baseline):
            yield Reason(sentence, case.fit_command, word=Trust.DO_NOT_USE)


def _describe_same_camera(rig: Rig, baseline: Baseline) -> str:
    """Return a sentence on two cameras that seem to be one; empty for two."""
    first, second = baseline.first, baseline.second
    if count := _count_copies(rig, first, second):
        return (
            f"{count} pictures of {second} are those of {first}, with equal corners: give {second}"
            " its own pictures."
        )
    if _is_same_place(rig, baseline):
        return (
            f"{first} and {second} stand at the same place,"
            f" {with_sigma(1000 * baseline.metres, 1000 * baseline.sigma)} mm apart and not turned,"
            " as one camera does whose pictures were taken twice: give each camera its own"
            " pictures."
        )
    return ""


def _count_copies(rig: Rig, first: str, second: str) -> int:
    """Return how many views of the second camera are views of the first, if most are."""
    views = rig.calibrations[second].views
    count = count_fitted(views, rig.calibrations[first].views)
    return count if 2 * count > len(views) else 0


def _is_same_place(rig: Rig, baseline: Baseline) -> bool:
    """Return True if neither a distance nor a turn of two cameras is significant."""
    if not rig.covariance.size:
        return False
    mountings = [rig.mounting(name) for name in (baseline.first, baseline.second)]
    turn = mountings[0].T_camera_reference[:3, :3] @ mountings[1].T_camera_reference[:3, :3].T
    angle = np.arccos(np.clip((np.trace(turn) - 1) / 2, -1.0, 1.0))
    sigma = np.linalg.norm([mounting.sigma[:3] for mounting in mountings])
    farthest = baseline.metres + SAME_PLACE_SIGMAS * baseline.sigma
    return bool(
        baseline.metres <= SAME_PLACE_SIGMAS * baseline.sigma
        and farthest < SAME_PLACE
        and angle <= SAME_PLACE_SIGMAS * sigma
    )


def uncertain_baselines(case: RigCase) -> Iterator[Reason]:
    """Yield a reason for each uncertain distance between a camera and the reference, where these
    are two cameras.
    """
    for baseline in case.rig.baselines:
        relative = baseline.sigma / baseline.metres if baseline.metres else np.inf
        is_first = case.rig.reference in (baseline.first, baseline.second)
        is_uncertain = case.rig.covariance.size and is_first and relative > MAX_BASELINE_SIGMA
        if is_uncertain and not _describe_same_camera(case.rig, baseline):
            yield Reason(
                f"the distance from {baseline.first} to {baseline.second} is"
                f" {with_sigma(1000 * baseline.metres, 1000 * baseline.sigma)} mm: add pictures of"
                " the board near and tilted, which both see.",
                case.fit_command,
            )


def rig_held_out(case: RigCase) -> Iterator[Reason]:
    """Yield reasons from held-out placements."""
    evaluation = case.evaluation
    if not evaluation:
        return
    errors = [calibration.stages[-1].rms_px for calibration in case.rig.calibrations.values()]
    fitted = float(np.sqrt(np.mean(np.square(errors))))
    if 2 * (count := evaluation.fitted_views) > evaluation.views:
        which = "all of" if count == evaluation.views else f"{count} of"
        yield Reason(
            f"the rig was fitted to {which} these views, so their error is no test: take new"
            " pictures, or leave some out of the fit.",
            _new_recording(case),
        )
    if evaluation.rms_px > MAX_HELD_OUT * fitted:
        is_elsewhere = evaluation.rms_px > max(HELD_OUT_ELSEWHERE * fitted, MIN_ELSEWHERE)
        cause = (
            "do not use it for such pictures. They are of another rig, its cameras have other"
            " names, or one has moved."
            if is_elsewhere
            else "the rig has changed, or the pictures of the fit were too few."
        )
        yield Reason(
            f"the error on held-out placements is {evaluation.rms_px:.3g} px and that of the fit"
            f" {fitted:.3g} px: {cause}",
            _new_recording(case) if is_elsewhere else case.fit_command,
            word=Trust.DO_NOT_USE if is_elsewhere else Trust.CARE,
        )
    for band in evaluation.lengths:
        count = band.placements
        by_chance = float(np.sqrt(chdtri(count, LENGTHS_CHANCE) / count))
        if band.normalised > max(MAX_NORMALISED, by_chance):
            yield Reason(
                f"lengths at {band.from_m:g} to {band.to_m:g} m are off by {band.rms_mm:.3g} mm,"
                f" {band.normalised:.1f} times what the calibration predicts.",
                case.fit_command,
            )


def _new_recording(case: RigCase) -> str:
    """Return the command that records the rig again."""
    return f"capture {shell_path(f'{case.source.parent}-again')} --source NAME=SOURCE ..."


def camera_reasons(case: RigCase) -> Iterator[Reason]:
    """Yield the reasons of each camera, with its name, and the commands of the rig. What makes the
    cameras disagree is in each camera's error as well, so the rig is diagnosed before a camera.
    """
    for name, calibration in case.rig.calibrations.items():
        for reason in judge(calibration, folder=case.folder / name).reasons:
            command = reason.next
            if command.startswith("calib fit "):
                command = case.fit_command
            elif command.startswith("capture "):  # of one camera alone
                command = _new_recording(case)
            elif command.startswith("calib diagnose "):
                command = case.diagnosis_command or command
            yield replace(reason, sentence=f"{name}: {reason.sentence}", next=command)


RIG_CHECKS: tuple[RigCheck, ...] = (
    rig_not_converged,
    same_camera,
    few_shared,
    left_out_pictures,
    found_effects,
    contradicted_baseline,
    disagreement,
    camera_reasons,
    uncertain_baselines,
    rig_held_out,
)
"""The checks in the order of their reasons; those that explain others come first."""
