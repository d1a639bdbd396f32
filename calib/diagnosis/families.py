"""What these views cannot tell apart: the rivals of every accepted effect, and how probable each is.

An accepted effect is taken out, every other that would explain about as much is fitted in its place, and the corners' marginal likelihoods
are compared. One beside which the accepted effect is needed all the same is no rival of it, but something else that may be missing (Bayes factors, equal odds beforehand). A name stands alone if it is almost sure; else it is the most probable of a family.

Source: R. E. Kass, A. E. Raftery, Bayes factors (1995).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from calib.diagnosis.finding import Family
from calib.diagnosis.fine_surface_search import surroundings
from calib.diagnosis.most_probable_form import with_most_probable
from calib.diagnosis.score_test import Optimum, ScoreTest
from calib.diagnosis.selection import Loop
from calib.diagnosis.sentences import separation
from calib.effects.effect import Effect
from calib.effects.registry import KINDS
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit

ALONE = 0.95
"""The probability from which a name stands alone."""
WORTH_NAMING = 0.01
"""The least of a member's."""
AS_MUCH = 0.5
"""Of what the accepted effect would lower the sum of squares by: a rival would do so much, to first order."""


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """Another effect in the place of an accepted one."""

    test: ScoreTest
    without: CameraModel
    """The model with neither."""
    model: CameraModel
    joint: JointFit


def settle(loop: Loop, tempered: float) -> tuple[Family, ...]:
    """The families of the accepted effects. Where a rival is more probable than what was accepted, it takes its place in the loop's model.

    Args:
        tempered: 0 to 1, how much a corner counts where what is left is not all noise.
    """
    found = []
    for effect in loop.model.effects:
        rivals = _rivals(loop, effect, tempered)
        names = [effect, *(rival.test.effect for rival in rivals)]
        likely = np.array([loop.joint.log_marginal, *(rival.joint.log_marginal for rival in rivals)])
        weighed = tempered * likely
        chances = np.exp(weighed - weighed.max()) / np.exp(weighed - weighed.max()).sum()
        best = int(chances.argmax())
        if best:
            better = rivals[best - 1]
            loop.replace(better.test, better.without, better.model, better.joint)
        members = [names[index] for index in np.argsort(-chances, kind="stable") if chances[index] > WORTH_NAMING]
        if chances[best] < ALONE:
            shares = {one.name: float(chances[names.index(one)]) for one in members}
            place = " or ".join(dict.fromkeys(one.about for one in members))
            found.append(Family(f"something about {place}", shares, separation(loop, members[0], members[1:])))
    return tuple(found)


def _rivals(loop: Loop, effect: Effect, tempered: float) -> list[Rival]:
    """The others that would explain as much in its place, fitted there, and leave it nothing to explain. What has no cause takes no name's
    place."""
    without = loop.base.with_effects(e for e in loop.model.effects if e is not effect)
    at = Optimum(without, loop.observations, without.fitted(loop.observations, loop.joint.poses, loop.joint.start))
    if not at.joint.finite:
        return []
    present = {e.name for e in loop.model.effects}
    there = surroundings(at, loop.board, loop.camera, place=False)
    enough = AS_MUCH * at.candidate(effect).chi2
    rivals = []
    for proposed in (e for kind in KINDS if kind.has_cause and kind.name not in present for e in kind.propose(there)):
        test = at.candidate(proposed)
        if test.chi2 < enough and proposed.judged_by_score:
            continue
        model, joint = with_most_probable(without, test.effect, loop.observations, at.joint.poses)
        if not joint.finite or tempered * (joint.log_marginal - loop.joint.log_marginal) < math.log(WORTH_NAMING):
            continue
        _, both = with_most_probable(loop.model, test.effect, loop.observations, loop.joint.poses)
        if tempered * (both.log_marginal - joint.log_marginal) < math.log(ALONE / (1 - ALONE)):
            rivals.append(Rival(replace(test, effect=model.effects[-1]), without, model, joint))
    return rivals
