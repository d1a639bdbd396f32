"""One candidate effect in one round of the loop, and how much it must do to be taken."""

from __future__ import annotations

import math
from dataclasses import dataclass

from calib.inference.cross_validation import Gain
from calib.inference.score_test import ModelFit, ScoreTest

ALPHA = 0.05
"""Chance of a false acceptance in a whole round, over all the candidates that are tried."""
LEAST_GAIN = 0.01
"""Of the held-out error: less is not worth an effect."""
LEAST_EXPLAINED = 0.003
"""px of the held-out error, nor is less than this: all corners of a picture may be off by 0.0013 px
(docs/corners.md).
"""


def worth(found: Gain) -> bool:
    """Whether it is large enough for an effect."""
    return found.relative > LEAST_GAIN and found.explained > LEAST_EXPLAINED


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """What was asked of it: a score, then a fit if that promises something, then held-out views if
    it is the most probable.
    """

    test: ScoreTest
    fit: ModelFit | None = None
    lowers: float = -math.inf
    """The fraction by which the fit lowers the root mean square of the views that it is a fit to.
    """
    among: int = 1
    """How many candidates there were."""
    odds: float = -math.inf
    """The logarithm by which the fit makes the corners more probable than the model without: at the
    optimum where both have the same parameters of single views; else with these integrated out,
    beside structure of no cause.
    """
    improbable: bool = False
    """Whether the corners are no more probable with it, its parameters integrated out."""
    finished: bool = False
    """Whether the fit is that of the most probable form, with the noise and the priors estimated
    anew.
    """
    gain: Gain | None = None
    bands: Gain | None = None
    """On depth bands that were held out, where there are such and the folds agree."""

    @property
    def fitted(self) -> ModelFit:
        """Of a trial that is known to have one."""
        assert self.fit
        return self.fit

    @property
    def confirmed(self) -> bool:
        """Whether held-out views say that it is not chance, all candidates of the round allowed
        for: by the test of its gain or, where its odds are sure, by the test of this candidate
        alone, or by whether they leave what the other views say of it. Where views are few or an
        effect is small, that it is there can be told long before how much of their error it takes.
        """
        if self.gain is None:
            return False
        if self.sure and self.gain.presence < ALPHA:
            return True
        return self.gain.ci95[0] > 0 and self.gain.p_value < (
            ALPHA if self.sure else ALPHA / self.among
        )

    @property
    def sure(self) -> bool:
        """Whether its odds are those of no chance, all candidates of the round allowed for."""
        return self.odds > math.log(self.among / ALPHA)

    @property
    def large(self) -> bool:
        """Whether its gain is confirmed, and worth it."""
        return self.confirmed and self.gain is not None and worth(self.gain)

    @property
    def passes(self) -> bool:
        """Whether what it says of some depths helps at the others, too; of one whose odds are sure,
        whether it does not harm there.
        """
        return self.large and (
            self.bands is None or self.bands.relative > 0 or (self.sure and self.bands.ci95[1] > 0)
        )
