"""Numbers that the views contradict."""

from dataclasses import replace

import numpy as np
import pytest

from calib.estimation.prior_conflict import independent_deviation, normalised_deviation
from calib.fit_record.request import Settings
from calib.fitting.stages import Setup
from calib.session.schema import Number
from fixtures.calibrated import CAMERA, tolerant
from fixtures.synthetic import INTRINSICS, Scene, scene


@pytest.mark.parametrize("noise", [0.1, 1.0, 10.0])
def test_distances_are_in_their_own_standard_deviations(noise: float) -> None:
    """Of numbers that are drawn from their tolerance and measured once: the posterior mean, and the
    measurement alone.
    """
    rng = np.random.default_rng(0)
    tolerance, draws = 2.0, 4000
    true = rng.normal(0, tolerance, draws)
    measured = true + rng.normal(0, noise, draws)
    variance = 1 / (tolerance**-2 + noise**-2)
    ours = [
        normalised_deviation(mean, tolerance, variance**0.5)
        for mean in measured * variance / noise**2
    ]
    theirs = [independent_deviation(mean, tolerance, noise) for mean in measured]
    for distances in (ours, theirs):
        assert np.mean(np.square(distances)) == pytest.approx(
            1.0, abs=3 * (2 / draws) ** 0.5
        )  # a chi-square's own scatter
    assert ours == pytest.approx(theirs), "it is the same thing, known from both ends"


def test_an_estimate_that_knows_nothing_contradicts_nothing() -> None:
    assert normalised_deviation(5.0, 1.0, 1.0) == 0.0


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(3, views=20, noise=0.02)


def test_a_number_that_is_told_wrong_is_found(made: Scene) -> None:
    wrong = replace(made.cover, parameters={**made.cover.parameters, "thickness": Number(0.006)})
    found = tolerant(made, Setup(made.board, CAMERA, INTRINSICS, wrong), Settings(grid=(6, 6)))
    assert found.declared.doubted == ("cover.thickness",)
    assert found.declared.cover.parameters["thickness"] == Number(0.006, 5e-4), (
        "what was declared is kept"
    )
    estimate = found.cover.parameters["thickness"]
    assert abs(estimate.value - 0.003) < 3 * estimate.sigma
    assert estimate.sigma < 5e-4, "it is the views that tell"


def test_true_numbers_are_believed(made: Scene) -> None:
    found = tolerant(made, Setup(made.board, CAMERA, INTRINSICS, made.cover), Settings(grid=(6, 6)))
    assert found.declared.doubted == ()
    for name, number in found.cover.parameters.items():
        assert abs(number.value - made.cover.parameters[name].value) <= 3.5 * number.sigma, name
