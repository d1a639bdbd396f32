"""The trial of one candidate effect in a round of the search, and the criteria of acceptance."""

from __future__ import annotations

import math
from dataclasses import dataclass

from calib.effects.effect import Effect
from calib.estimation.joint_fit import JointFit
from calib.inference.cross_validation import HeldOutGain
from calib.inference.fitted_model import ModelFit
from calib.inference.score_test import ScoreTest
from calib.inference.view_variation import MAX_DEVIATION

ALPHA = 0.05
"""The probability of a false acceptance in a round, over all candidates of the round."""
MIN_GAIN = 0.01
"""The smallest relative decrease of the held-out error that is worth an effect."""
MIN_EXPLAINED_PX = 0.003
"""The smallest part of the held-out error in px that is worth an effect: all corners of a picture
may have an error of 0.0013 px (docs/corners.md).
"""


def is_worthwhile(gain: HeldOutGain) -> bool:
    """Return True if the gain is large enough for an effect."""
    return gain.relative > MIN_GAIN and gain.explained_px > MIN_EXPLAINED_PX


def is_impossible(effect: Effect, joint: JointFit) -> bool:
    """Return True if an estimate is so far from what the prior of a physical quantity expects, or
    so small, that the effect is no explanation.
    """
    if effect.is_sum:
        return False
    scalars = [unknown for unknown in effect.effect_parameters if not unknown.param.shape]
    estimates = [float(joint.values[unknown.param.name]) for unknown in scalars]
    return any(
        abs(estimate - unknown.initial) > MAX_DEVIATION * unknown.sigma or estimate < unknown.lowest
        for estimate, unknown in zip(estimates, scalars, strict=True)
    )


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """A candidate: its score test, then a fit if the score is promising, then its held-out gain if
    it is the most probable.
    """

    test: ScoreTest
    fit: ModelFit | None = None
    error_decrease: float = -math.inf
    """The relative decrease of the root mean square error of the fitted views."""
    among: int = 1
    """The number of candidates."""
    log_odds: float = -math.inf
    """The log evidence of the fit minus that of the model without the effect. If only one of them
    has parameters of single views, these are integrated out, beside a model discrepancy.
    """
    improbable: bool = False
    """True if the evidence with the effect, its parameters integrated out, is not larger."""
    impossible: bool = False
    """True if a number of the fit is not possible (`is_impossible`)."""
    finished: bool = False
    """True if the fit has the most probable form of the effect, and its own noise and priors."""
    gain: HeldOutGain | None = None
    depth_gain: HeldOutGain | None = None
    """The gain on held-out depth bands, if there are bands and the folds show a gain."""

    @property
    def key(self) -> tuple[str, str]:
        """The name and the form of the effect."""
        return self.test.effect.name, self.test.effect.form

    @property
    def fitted(self) -> ModelFit:
        """The fit of a trial that has one."""
        assert self.fit
        return self.fit

    @property
    def confirmed(self) -> bool:
        """True if held-out views show that the effect is not chance.

        The test of the gain allows for all candidates of the round (Bonferroni). For decisive odds,
        the test of this candidate alone suffices, or the agreement of the held-out residuals with
        the prediction by the other views. With few views or a small effect, its presence is
        detectable long before the size of its gain.
        """
        if self.gain is None:
            return False
        if self.decisive and self.gain.presence_p_value < ALPHA:
            return True
        alpha = ALPHA if self.decisive else ALPHA / self.among
        return self.gain.ci95[0] > 0 and self.gain.p_value < alpha

    @property
    def decisive(self) -> bool:
        """True if the odds survive the Bonferroni correction for the candidates of the round."""
        return self.log_odds > math.log(self.among / ALPHA)

    @property
    def large(self) -> bool:
        """True if the gain is confirmed and worth an effect."""
        return self.confirmed and self.gain is not None and is_worthwhile(self.gain)

    @property
    def passes(self) -> bool:
        """True if the effect is large, and helps at depths that it was not fitted to; with decisive
        odds, if it does no harm there.
        """
        if not self.large or self.depth_gain is None:
            return self.large
        harmless = self.decisive and self.depth_gain.ci95[1] > 0
        return self.depth_gain.relative > 0 or harmless
