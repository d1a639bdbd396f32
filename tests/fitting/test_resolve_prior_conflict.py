"""What a fit believes of what it is told: tolerances, exact numbers where the model lacks
something, and neither of a wrong number.
"""

from dataclasses import replace

import pytest

from calib.estimation.prior_conflict import largest_prior_conflict
from calib.fitting.resolve_prior_conflict import ResolvedFit, resolve_prior_conflict
from calib.fitting.stages import Settings, Setup, fit_stages
from calib.progress import Silent
from calib.session.cover import Cover
from calib.session.freeing import ALL, AUTO
from calib.session.schema import Number
from calib.threads import single_thread
from fixtures.calibrated import CAMERA
from fixtures.synthetic import INTRINSICS, Scene, scene


def believed(made: Scene, cover: Cover, free: str = AUTO) -> tuple[ResolvedFit, Setup]:
    """And what was told."""
    settings = Settings(grid=(8, 8), free=(free,))
    told = Setup(made.board, CAMERA, INTRINSICS, cover)
    setup = told.with_tolerances(settings)
    with single_thread():
        first = fit_stages(setup, made.observations, settings, Silent())
        return resolve_prior_conflict(first, setup, told, made.views, settings, Silent()), told


@pytest.fixture(scope="module")
def good() -> Scene:
    return scene(3, views=20, noise=0.02)


def test_tolerances_that_the_estimates_keep_to_are_believed(good: Scene) -> None:
    found, told = believed(good, good.cover)
    assert found.setup == found.declared == told.with_tolerances(Settings())
    assert found.doubted == ()


def test_a_wrong_number_is_estimated_though_it_is_contradicted(good: Scene) -> None:
    found, told = believed(
        good, replace(good.cover, parameters={**good.cover.parameters, "thickness": Number(0.006)})
    )
    assert found.doubted == ("cover.thickness",)
    assert found.declared == told.with_tolerances(Settings())
    assert (
        found.setup.cover.parameters["thickness"].sigma
        > found.declared.cover.parameters["thickness"].sigma
    )


@pytest.mark.slow
def test_glass_that_the_prior_does_not_expect_leaves_numbers_as_they_are_declared() -> None:
    """Bumps of some 60 um on a fine grid: with tolerances, the numbers make up for what the
    relief's prior holds to be unlikely.
    """
    uneven = scene(1, views=16, grid=(10, 10), amplitude=1e-5, noise=0.1)
    found, told = believed(uneven, uneven.cover)
    assert found.setup == told
    asked, _ = believed(uneven, uneven.cover, ALL)
    assert asked.fitted.joint
    assert largest_prior_conflict(asked.fitted.joint) or asked.doubted, "what exact numbers spare"
