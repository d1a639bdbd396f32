"""Closing the loop: forward selection of the effects that the model lacks, then backward elimination of those it does not need.

In each round every effect is scored (score_test), the best few are fitted, and the one that lowers the error on held-out views most is
added, if it does so beyond chance (held_out) with all candidates tried so far allowed for (Bonferroni). It ends when none is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations

import numpy as np

from calib.diagnosis.fine_surface_search import surroundings
from calib.diagnosis.held_out import Gain, HeldOut, Split, gain, hold_out
from calib.diagnosis.most_probable_form import with_most_probable
from calib.diagnosis.score_test import Optimum, ScoreTest
from calib.effects.effect import Effect, Surroundings
from calib.effects.registry import EFFECTS, FIELDS
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations
from calib.progress import Advance
from calib.session.board import Board
from calib.session.camera import Camera

NEEDED = 0.05
"""p-value from which an accepted effect counts as needed beside those that came after it."""
ALPHA = 0.05
"""Chance of a false acceptance in a whole round, over all the candidates that are tried."""
LEAST_GAIN = 0.01
"""Of the held-out error: less is not worth an effect."""
LEAST_EXPLAINED = 0.003
"""px of the held-out error, nor is less than this: all corners of a picture may be off by 0.0013 px (docs/corners.md)."""
WORTH_TRYING = 0.05
"""p-value of the score."""
TRIED = 4
"""Candidates that are fitted in a round, best scores first; those whose neutral point says little of them come on top."""
ROUNDS = 6
CONFOUNDED = 0.9
"""Squared correlation from which two effects count as the same to these views."""


def worth(found: Gain) -> bool:
    """Whether it is large enough for an effect."""
    return found.relative > LEAST_GAIN and found.explained > LEAST_EXPLAINED


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """One candidate in one round."""

    test: ScoreTest
    gain: Gain | None = None
    held: HeldOut | None = None
    joint: JointFit | None = None
    among: int = 1
    """How many candidates there were."""
    bands: Gain | None = None
    """On depth bands that were held out, where there are such and the folds agree."""

    @property
    def confirmed(self) -> bool:
        """Whether held-out views say that its gain is not chance, all candidates of the round allowed for."""
        return self.gain is not None and self.gain.p_value < ALPHA / self.among and self.gain.ci95[0] > 0

    @property
    def large(self) -> bool:
        """Whether its gain is confirmed, and worth it."""
        return self.confirmed and self.gain is not None and worth(self.gain)

    @property
    def passes(self) -> bool:
        """Whether what it says of some depths helps at the others, too."""
        return self.large and (self.bands is None or self.bands.relative > 0)


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
    confounded: dict[str, set[str]] = field(default_factory=dict)
    done: int = 0
    known: dict[tuple[bool, bool], HeldOut] = field(default_factory=dict)
    """What the model leaves on held-out views, by `half` and `banded`."""

    def run(self) -> HeldOut:
        """Add what is missing; returns what was left on held-out views before."""
        first = self.left()
        newest = None
        for _ in range(ROUNDS):
            best = self._best()
            if not best:
                break
            self._accept(best)
            newest = self.model.effects[-1]
        self._backward(newest)
        return first

    def replace(self, test: ScoreTest, without: CameraModel, model: CameraModel, joint: JointFit) -> None:
        """Go on with another model, whose last effect, scored so, was not there `without`."""
        half = model.path.private
        before = self._fresh(without, half=half)
        self.model, self.joint = model, joint
        self.known.clear()
        held = self.left(half=half)
        self.trials[test.effect.name, test.effect.form] = Trial(test, gain(before, held), held, joint)

    def _best(self) -> Trial | None:
        """The next effect. Parameters of every view can imitate much, so they wait until no effect with a few for all views helps; and
        they are taken only if they make the corners more probable, themselves integrated out, than the model as it is, and than a field
        without a name that all views share."""
        shared, single = ([e for e in EFFECTS if bool(e.per_view) is alone] for alone in (False, True))
        if passing := self._passing(shared):
            return max(passing, key=lambda trial: trial.gain.relative if trial.gain else 0.0)
        private = self._passing(single, among=len(shared))
        asked = private or self.organised(self.model, self.joint)
        fields = self._passing(FIELDS, among=len(EFFECTS)) if asked else []
        return self._most_probable([*fields, *private])

    def _most_probable(self, trials: Sequence[Trial]) -> Trial | None:
        """Of trials whose numbers of parameters have no common measure, the one that makes the corners most probable; None where they are
        more probable without."""
        best, most = None, self.joint.log_marginal
        for trial in trials:
            assert trial.joint
            _, joint = with_most_probable(self.model, trial.test.effect, self.observations, trial.joint.poses)
            if joint.log_marginal > most:
                best, most = trial, joint.log_marginal
        return best

    def _passing(self, effects: Sequence[type[Effect]], among: int = 0) -> list[Trial]:
        """Score all effects, fit the best few, and return those that surely help.

        Args:
            among: candidates of which none passed before.
        """
        at = Optimum(self.model, self.observations, self.joint)
        there = surroundings(at, self.board, self.camera, place=any(kind.needs_place for kind in effects))
        scores = [at.candidate(effect) for effect in _proposed(effects, there, self.model.effects)]
        for test in scores:
            key = test.effect.name, test.effect.form
            if key not in self.trials or (not self.trials[key].gain and test.p_value < self.trials[key].test.p_value):
                self.trials[key] = Trial(test)
        self._note_confounded(scores)
        promising = (c for c in scores if c.effect.judged_by_score and c.p_value < WORTH_TRYING and c.promises > LEAST_GAIN)
        always = [c for c in scores if not c.effect.judged_by_score]
        chosen = always + sorted(promising, key=lambda c: 2 * c.dof - c.chi2)[:TRIED]
        tried = [self._try(test, among + len(scores)) for test in chosen]
        return [trial for trial in tried if trial.passes]

    def _try(self, test: ScoreTest, among: int) -> Trial:
        self._say(f"trying {test.effect.name}")
        wider = self.model.with_effect(test.effect)
        joint = wider.fitted(self.observations, self.joint.poses, self.joint.start)
        key = test.effect.name, test.effect.form
        known = self.trials.get(key)
        if not joint.finite:
            trial = Trial(test, joint=joint, among=among)
            self.trials[key] = known if known and known.gain else trial
            return trial
        half = wider.path.private
        held = hold_out(wider, self.observations, joint, self.folds, half=half)
        trial = Trial(test, gain(self.left(half=half), held), held, joint, among)
        if trial.large and self.bands:
            there = hold_out(wider, self.observations, joint, self.bands, half=half)
            trial = replace(trial, bands=gain(self.left(half=half, banded=True), there))
        if not (known and known.gain and trial.gain and known.gain.relative > trial.gain.relative):
            self.trials[key] = trial
        return trial

    def _accept(self, trial: Trial) -> None:
        """Take an effect in, with the noise and the prior estimated anew; where such a fit is not finite, the trial's stands."""
        assert trial.joint
        wider, joint = with_most_probable(self.model, trial.test.effect, self.observations, trial.joint.poses)
        if joint.finite:
            self.model, self.joint = wider, joint
        else:
            self.model, self.joint = self.model.with_effect(trial.test.effect), trial.joint
        self.known.clear()
        self._say(f"found {trial.test.effect.name}")

    def _backward(self, newest: Effect | None) -> None:
        """Drop what is no longer needed, the oldest first; the newest has just been asked for. What parameters of every view do as well is
        not dropped for it: an effect for all views is judged beside its like only."""
        for effect in self.model.effects:
            if effect is newest:
                continue
            beside = [e for e in self.model.effects if effect.per_view or not e.per_view]
            fewer = self.base.with_effects(e for e in beside if e is not effect)
            half = any(e.per_view for e in beside)
            left = self.left() if len(beside) == len(self.model.effects) else self._fresh(self.base.with_effects(beside), half=half)
            lost = gain(self._fresh(fewer, half=half), left)
            if lost.p_value > NEEDED or not worth(lost):
                model = self.base.with_effects(e for e in self.model.effects if e is not effect)
                joint = model.fitted(self.observations, self.joint.poses)
                if joint.finite:
                    self.model, self.joint = model, joint
                    self.known.clear()

    def _fresh(self, model: CameraModel, *, half: bool) -> HeldOut:
        """What another model leaves on held-out views."""
        self._say("what is needed")
        joint = model.fitted(self.observations, self.joint.poses, self.joint.start)
        return hold_out(model, self.observations, joint, self.folds, half=half)

    def left(self, *, half: bool | None = None, banded: bool = False) -> HeldOut:
        """What the model leaves on held-out views; whether its views' own parameters ask for half of the corners, it knows itself."""
        key = self.model.path.private if half is None else half, banded
        if key not in self.known:
            split = self.bands if banded and self.bands else self.folds
            self.known[key] = hold_out(self.model, self.observations, self.joint, split, half=key[0])
        return self.known[key]

    def _note_confounded(self, scores: Sequence[ScoreTest]) -> None:
        """Pairs of which the whole of the one that has fewer directions can be done by the other."""
        spans = [(test.effect.name, test.span()) for test in scores if test.jacobian.size]
        for (one, ours), (other, theirs) in combinations(spans, 2):
            if one == other or not (ours.size and theirs.size):
                continue
            if np.linalg.svd(ours.T @ theirs, compute_uv=False)[-1] ** 2 > CONFOUNDED:
                self.confounded.setdefault(one, set()).add(other)
                self.confounded.setdefault(other, set()).add(one)

    def _say(self, words: str) -> None:
        self.done += 1
        self.advance(self.done, words)


def _proposed(effects: Sequence[type[Effect]], there: Surroundings, present: Sequence[Effect]) -> Iterator[Effect]:
    taken = {effect.name for effect in present}
    for kind in effects:
        if kind.name not in taken:
            yield from kind.propose(there)
