"""Check: the residual is noise.

Otherwise report the effects that would explain it, or its structure.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
from scipy.special import chdtrc

from calib.calibration import Calibration
from calib.effects.cover_effect import CoverEffect
from calib.effects.effect import Effect
from calib.estimation.corner_cells import part_rows
from calib.estimation.noise import MIN_NOISE
from calib.estimation.residuals import Residuals
from calib.fitting.corner_range import corner_residuals
from calib.inference.residual_structure import (
    ORGANISER_WORDS,
    VarianceShare,
    significant_shares,
    variance_shares,
)
from calib.inference.score_test import ScoreTest
from calib.session.parameter_names import CAMERA
from calib.verdict.case import Case, optimum_of
from calib.verdict.thresholds import (
    AGREED,
    BEYOND_NOISE,
    MOST_NAMED,
    NAMED_BESIDE,
    SCORED,
    WORTH_NAMING,
)
from calib.verdict.verdict import Reason, Verdict, uncapitalised

MIN_PART = 0.05
"""The part of an error far above the noise that an effect explains at the least to be named."""
MANY = 10.0
"""Times, from which on the decimals do not matter."""
COVER_QUESTION = "If the camera looks through glass or plastic, describe its cover first."
OF_NOISE = "times the corners' noise"
NOT_ALL_NOISE = "the error is not all noise"
SHARED_ORGANISERS = ("image", "board")
"""What follows these is the same in all views."""
NUMBERS = {"focal": CAMERA.focal, "principal_point": CAMERA.centre}


def residual(case: Case) -> Iterator[Reason]:
    likely = likely_effects(case)
    noise = case.calibration.noise_px
    organised = significant_shares(_shares(case.calibration))
    likely = [(effect, gain) for effect, gain in likely if _explains(effect, gain, organised)]
    sentence = NOT_ALL_NOISE
    if noise is not None and beyond_noise(case):
        ratio = case.left_px / noise
        times = f"{ratio:.1f}" if ratio < MANY else f"{ratio:.0f}"
        likely = [(effect, gain) for effect, gain in likely if gain > MIN_PART]
        sentence = f"the error is {case.left_px:.3f} px, {times} {OF_NOISE} of about {noise:.3f} px"
    elif not (organised or likely):
        return
    if likely:
        effects = (
            f"{effect.name} ({uncapitalised(effect.description).removesuffix('.')})"
            for effect, _ in likely
        )
        (first, gain), *others = likely
        decreases = (
            f"{first.name} would have {100 * gain:.0f} % less error",
            *(f"{effect.name} {100 * gain:.0f} %" for effect, gain in others),
        )
        sentence += f": it may be {', or '.join(effects)}. A fit with {', with '.join(decreases)}."
    else:
        if organised:
            share = organised[0]
            sentence += (
                f"; {100 * share.fraction:.0f} % of it changes with"
                f" {ORGANISER_WORDS[share.organised_by]} ({100 * share.chance:.0f} % by chance)"
            )
        sentence += (
            ": the model lacks something, or the board, cover or intrinsics are not as described."
        )
        board = case.calibration.board
        is_dense = board.is_flat and not board.has_grid
        if is_dense and case.calibration.cover.shape != "none":
            sentence += " The report shows the glass in detail: look for drops and scratches."
    if case.calibration.cover.shape == "none" and not case.tried_all_shapes:
        sentence += f" {COVER_QUESTION}"
    diagnosed = case.calibration.history.diagnosis is not None
    suspects = tuple(dict.fromkeys(name for effect, _ in likely for name in suspects_of(effect)))
    yield Reason(sentence, case.next.report() if diagnosed else case.next.diagnose(), suspects)


def _explains(effect: Effect, gain: float, organised: Sequence[VarianceShare]) -> bool:
    """Return False for an effect of single views that explains less than what all views share: it
    only follows that.
    """
    shared = [share.fraction for share in organised if share.organised_by in SHARED_ORGANISERS]
    return not effect.per_view or 1 - (1 - gain) ** 2 > max(shared, default=0.0)


def asks_for_cover(verdict: Verdict) -> bool:
    """Return True if a cover that is not described may explain what the fit says of the board."""
    return any(COVER_QUESTION in reason.sentence for reason in verdict.reasons)


def beyond_noise(case: Case) -> bool:
    """True if much more than the corners' noise is left."""
    noise = case.calibration.noise_px
    return noise is not None and case.left_px > max(BEYOND_NOISE * noise, MIN_NOISE)


def likely_effects(case: Case) -> list[tuple[Effect, float]]:
    """Return the few significant effects with the fraction by which each would lower the error;
    effects with parameters of single views only if no other is significant.
    """
    return [(test.effect, gain) for test, gain in likely_scores(case).items()]


def likely_scores(case: Case) -> dict[ScoreTest, float]:
    """Return the score tests of these effects, with the same fractions."""
    scores = case.scores
    if not scores:
        return {}
    dispersion = _dispersion(case)
    noise, error = case.calibration.noise_px, case.left_px
    max_gain = max(0.0, 1.0 - noise / error) if noise is not None and error else 0.0

    def gain(test: ScoreTest) -> float:
        """Return the promised decrease beyond that by as many parameters on noise. The noise is a
        lower bound, however far the score extrapolates.
        """
        excess = max(0.0, test.chi2 - test.dof * dispersion)
        return min(max_gain, 1.0 - float(np.sqrt(1.0 - min(1.0, excess / test.cost))))

    gains = {test: gain(test) for test in significant_scores(case)}
    best = max(gains.values(), default=0.0)
    candidates = [test for test in gains if gains[test] > max(WORTH_NAMING, NAMED_BESIDE * best)]
    shared = [test for test in candidates if not test.effect.per_view]
    likely = sorted(
        shared or candidates, key=lambda test: -gains[test]
    )  # parameters of every view can imitate much
    return {test: gains[test] for test in likely[:MOST_NAMED]}


def significant_scores(case: Case) -> list[ScoreTest]:
    """Return the score tests of effects that chance does not explain, and on which the views agree.
    An effect that the uneven glass imitates may be among them: it lowers no error.
    """
    return [
        test
        for test in case.scores
        if chdtrc(test.dof, test.chi2 / _dispersion(case)) < SCORED / len(case.scores)
        and test.p_value < AGREED
    ]


def _dispersion(case: Case) -> float:
    """Return the mean square of the weighted residuals, for each degree of freedom."""
    degrees = 2 * len(case.observations.pixels) - case.calibration.poses.size
    return case.scores[0].cost / max(1, degrees)


@lru_cache(maxsize=1)  # a report and the command that writes it both judge
def _shares(calibration: Calibration) -> tuple[VarianceShare, ...]:
    fitted = optimum_of(calibration)
    residual = corner_residuals(calibration)
    rows = part_rows(fitted.observations)
    corners = fitted.observations.select_rows(rows)
    errors = Residuals(residual.image[rows], residual.board[rows])
    return tuple(variance_shares(calibration, fitted.model, fitted.joint, corners, errors))


def suspects_of(effect: Effect) -> tuple[str, ...]:
    """Return the names of the numbers that an effect changes, or its own name."""
    return (
        effect.parameters
        if isinstance(effect, CoverEffect)
        else NUMBERS.get(effect.name, (effect.name,))
    )
