"""What is left, where noise is all that should be: which effects would explain it, or else what
organises it.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from scipy.special import chdtrc

from calib.calibration import Calibration
from calib.effects.cover_effect import CoverEffect
from calib.effects.effect import Effect
from calib.estimation.noise import MIN_NOISE
from calib.estimation.residuals import residuals
from calib.inference.residual_structure import VarianceShare, significant_shares, variance_shares
from calib.inference.score_test import ScoreTest
from calib.verdict.case import Case, optimum_of
from calib.verdict.thresholds import (
    AGREED,
    BEYOND_NOISE,
    MOST_NAMED,
    NAMED_BESIDE,
    SCORED,
    WORTH_NAMING,
)
from calib.verdict.verdict import Reason

NOT_ALL_NOISE = "what is left is not all noise"
NUMBERS = {"focal": ("camera.fx", "camera.fy"), "principal_point": ("camera.cx", "camera.cy")}


def residual(case: Case) -> Iterator[Reason]:
    likely = likely_effects(case)
    noise = case.calibration.noise_px
    organised = significant_shares(_shares(case.calibration))
    large = case.left_px > max(BEYOND_NOISE * noise, MIN_NOISE)
    if not (large or organised or likely):
        return
    said = (
        f"{case.left_px:.3f} px are left where the corners' noise is about {noise:.3f} px"
        if large
        else NOT_ALL_NOISE
    )
    if organised:
        most = organised[0]
        said += (
            f", and {100 * most.fraction:.0f} % of it go with {most.organised_by}"
            f" ({100 * most.chance:.0f} % by chance)"
        )
    if likely:
        names = (
            f"{effect.name}, which would lower it by {100 * gain:.0f} %" for effect, gain in likely
        )
        said += f": it may be {', or '.join(names)}."
    else:
        said += (
            ": the model lacks something, or the board, cover or intrinsics are not as described."
        )
    diagnosed = "diagnosis" in case.calibration.settings
    suspects = tuple(dict.fromkeys(name for effect, _ in likely for name in suspects_of(effect)))
    yield Reason(said, case.next.report() if diagnosed else case.next.diagnose(), suspects)


def likely_effects(case: Case) -> list[tuple[Effect, float]]:
    """The few that would surely explain something, each with the fraction by which it would lower
    the error; one with parameters of every view only where no other would.
    """
    scores = case.scores
    if not scores:
        return []
    dispersion = scores[0].cost / max(
        1, 2 * len(case.observations.pixels) - case.calibration.poses.size
    )

    most = max(0.0, 1.0 - case.calibration.noise_px / case.left_px) if case.left_px else 0.0

    def gain(test: ScoreTest) -> float:
        """What it promises beyond what as many parameters would lower of noise; below which nothing
        goes, however far a score is from where it says the truth.
        """
        beyond = max(0.0, test.chi2 - test.dof * dispersion)
        return min(most, 1.0 - float(np.sqrt(1.0 - min(1.0, beyond / test.cost))))

    def sure(test: ScoreTest) -> bool:
        return test.p_value < AGREED and float(
            chdtrc(test.dof, test.chi2 / dispersion)
        ) < SCORED / len(scores)

    gains = {test: gain(test) for test in scores if sure(test)}
    best = max(gains.values(), default=0.0)
    named = [test for test in gains if gains[test] > max(WORTH_NAMING, NAMED_BESIDE * best)]
    shared = [test for test in named if not test.effect.per_view]
    likely = sorted(
        shared or named, key=lambda test: -gains[test]
    )  # parameters of every view can imitate much
    return [(test.effect, gains[test]) for test in likely[:MOST_NAMED]]


@lru_cache(maxsize=1)  # a report and the command that writes it both judge
def _shares(calibration: Calibration) -> tuple[VarianceShare, ...]:
    at = optimum_of(calibration)
    path, values = calibration.model()
    missed = residuals(path, values, at.observations, at.joint.poses)
    return tuple(variance_shares(calibration, at.model, at.joint, at.observations, missed))


def suspects_of(effect: Effect) -> tuple[str, ...]:
    """The numbers that it is about, or its own name."""
    return (
        effect.parameters
        if isinstance(effect, CoverEffect)
        else NUMBERS.get(effect.name, (effect.name,))
    )
