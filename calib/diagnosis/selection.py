"""Closing the loop: forward selection of the effects that the model lacks, then backward
elimination of those it does not need.

In each round every effect is scored (score_test), the best few are fitted, and the one that lowers
the error on held-out views most is added, if it does so beyond chance (held_out) with all
candidates tried so far allowed for (Bonferroni). It ends when none is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from calib.diagnosis.backward_pass import drop_idle
from calib.diagnosis.far_start import rough_fit
from calib.diagnosis.fewer_effects import FewerEffects
from calib.diagnosis.fine_surface_search import surroundings
from calib.diagnosis.held_out import HeldOut, Split, gain, hold_out
from calib.diagnosis.most_probable_form import with_most_probable
from calib.diagnosis.score_test import Optimum, ScoreTest
from calib.diagnosis.simpler_forms import simplified
from calib.diagnosis.trial import LEAST_GAIN, Fit, Trial
from calib.diagnosis.unnamed_structure import gain as gain_of_structure
from calib.effects.effect import Effect
from calib.effects.registry import EFFECTS, FIELDS
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.progress import Advance
from calib.session.board import Board
from calib.session.camera import Camera

WORTH_TRYING = 0.05
"""p-value of the score."""
TRIED = 4
"""Candidates that are fitted in a round, best scores first; those whose neutral point says little
of them come on top.
"""
HOPELESS = 3.0
"""Times the error without it."""
MOST_EFFECTS = 6
"""Effects at most. One that turns out idle makes room for another."""
CONFOUNDED = 0.9
"""Squared correlation from which two effects count as the same to these views."""


@dataclass(slots=True, eq=False)
class Loop:
    """Forward selection, then a backward pass."""

    board: Board
    camera: Camera
    observations: Observations
    folds: Split
    bands: Split | None
    base: CameraModel
    """Without any effect."""
    model: CameraModel
    joint: JointFit
    advance: Advance
    organised: Callable[[CameraModel, JointFit], bool]
    """Whether what a fit leaves is more than noise."""
    trials: dict[tuple[str, str], Trial] = field(default_factory=dict)
    """By effect and form: where each came closest."""
    hopeless: set[tuple[str, str]] = field(default_factory=set)
    """Those of which a fit left so much more that they are none of the causes, whatever else there
    is: they are not asked again.
    """
    confounded: dict[str, set[str]] = field(default_factory=dict)
    dropped: set[str] = field(default_factory=set)
    """Effects that were accepted and that what came after them did without: they are not asked
    again.
    """
    done: int = 0
    known: dict[tuple[bool, bool], HeldOut] = field(default_factory=dict)
    """What the model leaves on held-out views, by `half` and `banded`."""
    apart: dict[tuple[tuple[str, ...], bool], HeldOut] = field(default_factory=dict)
    """What some of its effects alone leave there, by these and `half`."""
    fewer: FewerEffects = field(init=False)
    structured: float | None = None
    """By how much structure of no cause beside the model makes the corners more probable: the
    logarithm.
    """

    def __post_init__(self) -> None:
        self.fewer = FewerEffects(self.base, self.observations)

    def run(self) -> HeldOut:
        """Add what is missing; returns what was left on held-out views before."""
        first = self.left()
        added = self._add_what_helps()  # if nothing, what was added before may still be idle
        full = len(self.model.effects) == MOST_EFFECTS
        while (
            drop_idle(self, self.model.effects[-1] if added else None)
            and full
            and (added := self._add_what_helps())
        ):
            full = len(self.model.effects) == MOST_EFFECTS
        return first

    def _add_what_helps(self) -> bool:
        """Effects, one after the other; whether there was any."""
        before = self.model
        while len(self.model.effects) < MOST_EFFECTS and (best := self._best()):
            self._accept(best)
        return self.model is not before

    def replace(
        self, test: ScoreTest, without: CameraModel, model: CameraModel, joint: JointFit
    ) -> None:
        """Go on with another model, whose last effect, scored so, was not there `without`."""
        half = model.path.has_private_blocks
        before = self.left_of(without.effects, half=half)
        self.go_on_with(Fit(model, joint))
        shown = gain(before, self.left(half=half))
        self.trials[test.effect.name, test.effect.form] = Trial(test, Fit(model, joint), gain=shown)

    def _best(self) -> Trial | None:
        """The next effect. Parameters of every view can imitate much, so they wait until no effect
        with a few for all views helps; and they are taken only if they make the corners more
        probable, themselves integrated out, than the model as it is, and than a field without a
        name that all views share.
        """
        shared, single = (
            [e for e in EFFECTS if bool(e.per_view) is alone] for alone in (False, True)
        )
        fitted = self._lowering(shared)
        if passing := self._first_passing(fitted, lambda fit: fit.joint.log_evidence):
            return passing
        moving = self._more_probable(self._lowering(single, among=len(shared)))
        private = self._first_passing(self._caused(moving), lambda fit: fit.joint.log_marginal)
        if not (private or self.organised(self.model, self.joint)):
            return None
        ahead = private.fitted.joint.log_marginal - self.joint.log_marginal if private else 0.0
        fields = self._more_probable(self._lowering(FIELDS, among=len(EFFECTS), least=ahead))
        better = [
            field
            for field in fields
            if not private or field.fitted.joint.log_marginal > private.fitted.joint.log_marginal
        ]
        return self._first_passing(better, lambda fit: fit.joint.log_marginal) or private

    def _lowering(
        self, effects: Sequence[type[Effect]], among: int = 0, least: float = 0.0
    ) -> list[Trial]:
        """Score all effects, fit the best few, and return those that lower the error enough to be
        worth holding views out.

        Args:
            among: candidates of which none passed before.
            least: the logarithm by which one must be able to make the corners more probable: by
                half of its chi2 at best.
        """
        scores = self.scores(effects)
        judged = (c for c in scores if c.effect.judged_by_score and c.chi2 / 2 > least)
        promising = (c for c in judged if c.p_value < WORTH_TRYING and c.promises > LEAST_GAIN)
        always = [
            c
            for c in scores
            if not (c.effect.judged_by_score or (c.effect.name, c.effect.form) in self.hopeless)
        ]
        chosen = always + sorted(promising, key=lambda c: 2 * c.dof - c.chi2)[:TRIED]
        tried = [self._try(test, among + len(scores)) for test in chosen]
        return [trial for trial in tried if trial.lowers > LEAST_GAIN and not trial.improbable]

    def scores(self, effects: Sequence[type[Effect]]) -> list[ScoreTest]:
        """What the residual says of each effect."""
        at = Optimum(self.model, self.observations, self.joint)
        there = surroundings(
            at, self.board, self.camera, place=any(kind.needs_place for kind in effects)
        )
        taken = self.dropped | {effect.name for effect in self.model.effects}
        found = at.candidates(
            [effect for kind in effects if kind.name not in taken for effect in kind.propose(there)]
        )
        for test in found:
            key = test.effect.name, test.effect.form
            if key not in self.trials or (
                not self.trials[key].gain and test.p_value < self.trials[key].test.p_value
            ):
                self.trials[key] = Trial(test)
        self._note_confounded(found)
        return found

    def _try(self, test: ScoreTest, among: int) -> Trial:
        """Fit to all views."""
        self._say(f"trying {test.effect.name}")
        wider = self.model.with_effect(test.effect)
        joint = rough_fit(wider, self.observations, self.joint)
        lowers = 1 - (joint.cost / self.joint.cost) ** 0.5 if joint.finite else -np.inf
        odds = joint.log_evidence - self.joint.log_evidence if joint.finite else -np.inf
        shared = not test.effect.per_view
        if joint.finite and lowers < 1 - HOPELESS:
            self.hopeless.add((test.effect.name, test.effect.form))
        trial = Trial(
            test,
            Fit(wider, joint),
            lowers,
            among,
            odds if shared else -np.inf,
            improbable=shared and odds <= 0,
        )
        key = test.effect.name, test.effect.form
        if not self.trials[key].gain:
            self.trials[key] = trial
        return trial

    def _more_probable(self, trials: Sequence[Trial]) -> list[Trial]:
        """Of trials whose numbers of parameters have no common measure, those that make the corners
        more probable than the model as it is, in their most probable forms.
        """
        found = []
        for trial in trials:
            model, joint = with_most_probable(
                self.model, trial.test.effect, self.observations, trial.fitted.joint
            )
            trial = replace(
                trial,
                fit=Fit(model, joint),
                finished=True,
                odds=-np.inf,
                improbable=joint.log_marginal <= self.joint.log_marginal,
            )
            if trial.improbable:
                self.trials[trial.test.effect.name, trial.test.effect.form] = trial
            else:
                found.append(trial)
        return found

    def _caused(self, trials: Sequence[Trial]) -> list[Trial]:
        """Of trials of what single views have for themselves, those without which structure of no
        cause does not make the corners as
        probable: what a model lacks in single views, small numbers in single views follow, whatever
            they are called.
        """
        found = []
        for trial in trials:
            odds = (
                trial.fitted.joint.log_marginal
                - self.joint.log_marginal
                + self._structure_left(trial)
            )
            known = replace(trial, odds=odds)
            if known.sure:
                found.append(known)
        return found

    def _structure_left(self, trial: Trial) -> float:
        """By how much more, or less where it is negative, structure of no cause has to explain with
        the trial than without.
        """
        if self.structured is None:
            self.structured = gain_of_structure(Optimum(self.model, self.observations, self.joint))
        return (
            gain_of_structure(Optimum(trial.fitted.model, self.observations, trial.fitted.joint))
            - self.structured
        )

    def _first_passing(
        self, trials: Sequence[Trial], probable: Callable[[Fit], float]
    ) -> Trial | None:
        """The most probable of the trials that held-out views confirm."""
        for trial in sorted(trials, key=lambda trial: probable(trial.fitted), reverse=True):
            if (held := self._held_out(trial)).passes:
                return held
        return None

    def _held_out(self, trial: Trial) -> Trial:
        """A trial with its errors on views that no fit has seen."""
        model, joint = trial.fitted.model, trial.fitted.joint
        if not trial.finished:  # once, or every fold has to
            joint = model.fit(self.observations, joint.poses, joint.start)
            trial = replace(trial, fit=Fit(model, joint))
        half = model.path.has_private_blocks
        held = hold_out(model, self.observations, joint, self.folds, half=half)
        trial = replace(trial, gain=gain(self.left(half=half), held))
        if trial.large and self.bands:
            there = hold_out(model, self.observations, joint, self.bands, half=half)
            trial = replace(trial, bands=gain(self.left(half=half, banded=True), there))
        key = trial.test.effect.name, trial.test.effect.form
        known = self.trials[key]
        if not (known.gain and trial.gain and known.gain.relative > trial.gain.relative):
            self.trials[key] = trial
        return trial

    def _accept(self, trial: Trial) -> None:
        """Take an effect in, with the noise and the prior estimated anew; where such a fit is not
        finite, the trial's stands.
        """
        wider, joint = trial.fitted.model, trial.fitted.joint
        if not trial.finished:
            anew = with_most_probable(self.model, trial.test.effect, self.observations, joint)
            wider, joint = anew if anew[1].finite else (wider, joint)
        self.fewer.passed(Fit(self.model, self.joint))
        self.go_on_with(Fit(wider, joint))
        self._say(f"found {trial.test.effect.name}")

    def simplify(self) -> None:
        """Effects in simpler forms where the corners are more probable so."""
        fit = simplified(Fit(self.model, self.joint), self.base, self.observations)
        if fit.model is not self.model:
            self.go_on_with(fit)

    def with_only(self, effects: Sequence[Effect]) -> Fit:
        """The model with some of its effects alone, with its noise and prior."""
        return self.fewer.fitted(Fit(self.model, self.joint), effects)

    def left_of(self, effects: Sequence[Effect], *, half: bool) -> HeldOut:
        """What the model leaves on held-out views with some of its effects alone."""
        key = tuple(effect.name for effect in effects), half
        if key not in self.apart:
            self._say("what is needed")
            fit = self.with_only(effects)
            self.apart[key] = hold_out(
                fit.model, self.observations, fit.joint, self.folds, half=half
            )
        return self.apart[key]

    def left(self, *, half: bool | None = None, banded: bool = False) -> HeldOut:
        """What the model leaves on held-out views; whether its views' own parameters ask for half
        of the corners, it knows itself.
        """
        key = self.model.path.has_private_blocks if half is None else half, banded
        if key not in self.known:
            split = self.bands if banded and self.bands else self.folds
            self.known[key] = hold_out(
                self.model, self.observations, self.joint, split, half=key[0]
            )
        return self.known[key]

    def _note_confounded(self, scores: Sequence[ScoreTest]) -> None:
        """Pairs of which the whole of the one that has fewer directions can be done by the
        other.
        """
        spans = [(test.effect.name, test.span()) for test in scores if test.jacobian.size]
        for (one, ours), (other, theirs) in combinations(spans, 2):
            if one == other or not (ours.size and theirs.size):
                continue
            if np.linalg.svd(ours.T @ theirs, compute_uv=False)[-1] ** 2 > CONFOUNDED:
                self.confounded.setdefault(one, set()).add(other)
                self.confounded.setdefault(other, set()).add(one)

    def go_on_with(self, fit: Fit) -> None:
        """What was known of the model of before is known no more."""
        self.model, self.joint = fit.model, fit.joint
        self.known.clear()
        self.apart.clear()
        self.fewer.forget()
        self.structured = None

    def _say(self, words: str) -> None:
        self.done += 1
        self.advance(self.done, words)
