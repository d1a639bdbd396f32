"""What these views cannot tell apart: the rivals of every accepted effect, and how probable each
is.

An accepted effect is taken out, every other that can do much of what it does is fitted in its
place, and the corners' marginal likelihoods are compared (Bayes factors, with the effects' odds
beforehand). A name stands alone if it is almost sure, by these views alone too; else it is the most
probable of a family.

Source: R. E. Kass, A. E. Raftery, Bayes factors (1995).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from calib.diagnosis.agreement import agreement
from calib.diagnosis.backward_pass import drop_idle
from calib.diagnosis.far_start import rough_fit
from calib.diagnosis.finding import Family
from calib.diagnosis.fine_surface_search import surroundings
from calib.diagnosis.most_probable_form import with_most_probable
from calib.diagnosis.score_test import Optimum, ScoreTest
from calib.diagnosis.selection import Loop
from calib.diagnosis.sentences import separation
from calib.diagnosis.trial import Fit
from calib.effects.effect import Effect
from calib.effects.registry import KINDS
from calib.estimation.camera_model import CameraModel
from calib.estimation.joint_fit import JointFit
from calib.estimation.observations import Observations

ALONE = 0.95
"""The probability from which a name stands alone."""
WORTH_NAMING = 0.01
"""The least of a member's."""
MUCH = 0.5
"""A rival does so much of what the accepted effect does: of the squares of its shifts, beside what
other parameters can do; where one of them has parameters of single views, of what the sum of
squares would fall by.
"""

BEYOND_HOPE = 12.0
"""Standard deviations of the views' disagreement, from which a rival's rough fit is behind beyond
hope.
"""
PASSES = 3
"""How often each effect is asked at most: one that gave way changes what its neighbours' rivals are
worth.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Rival:
    """Another effect in the place of an accepted one."""

    test: ScoreTest
    without: CameraModel
    """The model with neither."""
    model: CameraModel
    joint: JointFit


def settle(loop: Loop) -> tuple[Family, ...]:
    """The families of the accepted effects. Where a rival took the place of one, what stood beside
    that may have done the rival's work, and is dropped if it is not needed any more. Effects are in
    the simplest forms that the others leave them.
    """
    loop.simplify()
    before = loop.model
    families = _settled(loop)
    if loop.model is before:
        return families
    after = loop.model
    drop_idle(loop)
    loop.simplify()
    return families if loop.model is after else _settled(loop)


def _settled(loop: Loop) -> tuple[Family, ...]:
    """A rival that is more probable than what was accepted takes its place in the loop's model;
    what was said of others is then out of date, and is asked again.
    """
    known = dict[str, tuple[CameraModel, Family | None]]()
    for _ in range(PASSES * len(loop.model.effects)):
        stale = [
            effect
            for effect in loop.model.effects
            if effect.name not in known or known[effect.name][0] is not loop.model
        ]
        if not stale:
            break
        name, family = _family(loop, stale[0])
        known[name] = loop.model, family
    asked = (known[effect.name] for effect in loop.model.effects if effect.name in known)
    return tuple(family for _, family in asked if family)


def _family(loop: Loop, effect: Effect) -> tuple[str, Family | None]:
    """The name of the most probable in the place of an accepted effect, and the family where it is
    not almost sure.
    """
    rivals = _rivals(loop, effect)
    names = [effect, *(rival.test.effect for rival in rivals)]
    fits = [Fit(loop.model, loop.joint), *(Fit(rival.model, rival.joint) for rival in rivals)]
    likeliest = int(np.argmax([fit.joint.log_marginal for fit in fits]))
    odds = np.array([_odds(fit, fits[likeliest], loop.observations) for fit in fits])
    even = odds / odds.sum()
    weighed = odds * [one.prior_odds for one in names]
    chances = weighed / weighed.sum()
    best = int(np.argmax(chances))
    if best:
        better = rivals[best - 1]
        loop.replace(better.test, better.without, better.model, better.joint)
    if min(chances[best], even[best]) >= ALONE:  # the views must say so by themselves
        return names[best].name, None
    members = [
        names[index]
        for index in np.argsort(-chances, kind="stable")
        if max(chances[index], even[index]) > WORTH_NAMING
    ]
    shares = {one.name: float(chances[names.index(one)]) for one in members}
    place = " or ".join(dict.fromkeys(one.about for one in members))
    return names[best].name, Family(
        f"something about {place}", shares, separation(loop, members[0], members[1:])
    )


def _odds(fit: Fit, best: Fit, observations: Observations) -> float:
    """Of a fit against the most probable one: by their marginal likelihoods or, where that is less
    sure of itself, by how the views agree that these differ (Vuong's test, in which neither model
    need be right).
    """
    if fit is best:
        return 1.0
    apart = best.joint.log_marginal - fit.joint.log_marginal
    agreed = float(ndtr(-agreement(best, fit, apart, observations)))
    return max(float(np.exp(-apart)), agreed / (1 - agreed))


def _rivals(loop: Loop, effect: Effect) -> list[Rival]:
    """The others that do much of what it does, fitted in its place.

    What has no cause takes no name's place.
    """
    fewer = loop.with_only([e for e in loop.model.effects if e is not effect])
    without, at = fewer.model, Optimum(fewer.model, loop.observations, fewer.joint)
    if not at.joint.finite:
        return []
    present = {e.name for e in loop.model.effects}
    there = surroundings(at, loop.board, loop.camera, place=False)
    own = at.test(effect)
    moved = _moved(own, loop.joint)
    rivals = []
    proposed = [
        e
        for kind in KINDS
        if kind.has_cause and kind.name not in present
        for e in kind.propose(there)
    ]
    for test in at.candidates(proposed):
        shared = moved.size and test.jacobian.size
        done = (
            float(((test.span().T @ moved) ** 2).sum() / (moved @ moved))
            if shared
            else test.chi2 / own.chi2
        )
        if done < MUCH or (test.effect.name, test.effect.form) in loop.hopeless:
            continue
        if (rough := _near(loop, without, test.effect, at.joint)) is None:
            continue
        model, joint = with_most_probable(without, test.effect, loop.observations, rough)
        if (
            joint.finite and joint.log_marginal > at.joint.log_marginal
        ):  # else its fit did not come down, or it does nothing
            rivals.append(Rival(replace(test, effect=model.effects[-1]), without, model, joint))
    return rivals


def _near(loop: Loop, without: CameraModel, effect: Effect, begin: JointFit) -> JointFit | None:
    """A rough fit with another effect, unless it is so much worse that a better one would not make
    up for it.
    """
    model = without.with_effect(effect)
    joint = rough_fit(model, loop.observations, begin)
    if not joint.finite:
        return None
    apart = loop.joint.log_marginal - joint.log_marginal
    behind = agreement(Fit(loop.model, loop.joint), Fit(model, joint), apart, loop.observations)
    return None if behind > BEYOND_HOPE else joint


def _moved(test: ScoreTest, joint: JointFit) -> NDArray[np.float64]:
    """(2M,) by how much a fitted effect moves corners, over sigma, beside what the other parameters
    can do; (0,) of parameters of views.
    """
    if not test.jacobian.size:
        return np.zeros(0)
    sizes = [
        (joint.values[u.param.name].numpy().ravel() - u.neutral) / u.param.scale
        for u in test.effect.effect_parameters
    ]
    return np.asarray(test.jacobian @ np.concatenate(sizes))
