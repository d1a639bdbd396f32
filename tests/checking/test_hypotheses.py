"""A change that cannot happen to one camera means another camera, and a change that explains
nothing is no explanation.
"""

import re

import numpy as np
import pytest
import torch

from calib import cli
from calib.checking.hypotheses import IMMERSED, OTHER_CAMERA, Hypothesis, _bounded, _explains
from calib.checking.picture_mode import PictureMode
from calib.commands.command_line import _parser
from calib.effects.effect import Effect
from calib.effects.focal import Focal
from calib.estimation.residuals import Residuals


def hypothesis(change: Effect, size: float) -> Hypothesis:
    """Return a change by so many standard deviations of its prior."""
    spread = np.concatenate(
        [
            np.full(max(1, int(np.prod(u.param.shape))), u.sigma / u.param.scale)
            for u in change.effect_parameters
        ]
    )
    return Hypothesis(change.name, 1.0, change, size * spread, np.diag(spread**2))


def test_a_change_beyond_what_is_possible_is_another_camera() -> None:
    possible = hypothesis(Focal(), 9.0)
    assert _bounded(possible) is possible
    impossible = _bounded(hypothesis(Focal(), -20.0))
    assert impossible.name == OTHER_CAMERA
    assert impossible.change is None
    assert "another camera or through another cover" in impossible.words
    mode = hypothesis(PictureMode(640, 480), 100.0)
    assert _bounded(mode) is mode, "pictures may have any size"


@pytest.mark.parametrize(("left_px", "explains"), [(0.5, True), (2.5, False)])
def test_a_change_that_leaves_most_of_a_large_error_explains_nothing(
    left_px: float, explains: bool
) -> None:
    image = torch.full((4, 2), left_px / 2**0.5, dtype=torch.float64)
    fit = Hypothesis("focal", 1.0, residuals=Residuals(image, image))
    assert _explains(fit, error=3.0, sigma=0.01) is explains
    assert _explains(fit, error=3.0, sigma=0.3), "an error near the noise"


def test_the_advice_on_another_medium_is_a_whole_command() -> None:
    parser = _parser("calib", "", cli.COMMANDS, cli.GROUPS)
    for words in IMMERSED.values():
        command = re.search("`calib (immerse .*)`, with", words)
        assert command
        parser.parse_args(command[1].split())
