"""A fit trusts tolerances, holds numbers exactly where the model lacks an effect, and widens the
prior of a wrong number.
"""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from calib.estimation.prior_conflict import largest_prior_conflict
from calib.fit_record.request import Settings
from calib.fitting.fit import fit
from calib.fitting.resolve_prior_conflict import ResolvedFit, resolve_prior_conflict
from calib.fitting.setup import Setup
from calib.fitting.stages import fit_stages
from calib.progress import Silent
from calib.session.cover import Cover
from calib.session.freeing import ALL
from calib.session.schema import Number
from calib.session.session import read_session
from calib.threads import single_thread
from fixtures.calibrated import CAMERA
from fixtures.rays import FIXTURES
from fixtures.synthetic import INTRINSICS, Scene, scene

COARSE = Settings(grid=(8, 8))


def resolve(made: Scene, cover: Cover, settings: Settings = COARSE) -> tuple[ResolvedFit, Setup]:
    """Return the resolved fit and the setup as declared."""
    fixed_setup = Setup(made.board, CAMERA, INTRINSICS, cover)
    setup = fixed_setup.with_tolerances(settings)
    with single_thread():
        first = fit_stages(setup, made.observations, settings, Silent())
        return resolve_prior_conflict(
            first, setup, fixed_setup, made.views, settings, Silent()
        ), fixed_setup


@pytest.fixture(scope="module")
def good() -> Scene:
    return scene(3, views=20, noise=0.02)


def test_tolerances_are_used_if_the_estimates_keep_to_them(good: Scene) -> None:
    resolved, fixed_setup = resolve(good, good.cover)
    assert resolved.setup == resolved.declared == fixed_setup.with_tolerances(Settings())
    assert resolved.doubted == ()


def test_a_wrong_number_is_estimated_though_it_is_contradicted(good: Scene) -> None:
    resolved, fixed_setup = resolve(
        good, replace(good.cover, parameters={**good.cover.parameters, "thickness": Number(0.006)})
    )
    assert resolved.doubted == ("cover.thickness",)
    assert resolved.declared == fixed_setup.with_tolerances(Settings())
    assert (
        resolved.setup.cover.parameters["thickness"].sigma
        > resolved.declared.cover.parameters["thickness"].sigma
    )


@pytest.mark.slow
def test_a_wrong_index_does_not_pull_its_estimate(tmp_path: Path) -> None:
    """The wider prior costs evidence, and the estimate with the narrow one is off by 7 sigma."""
    clean = yaml.safe_load((FIXTURES / "clean" / "session.yaml").read_text())
    true = clean["cover"]["refractive_index"]
    clean["cover"]["refractive_index"] = 1.33
    (tmp_path / "session.yaml").write_text(yaml.safe_dump(clean))
    (tmp_path / "frames").symlink_to(FIXTURES / "clean" / "frames")
    index = fit(read_session(tmp_path)).cover.numbers["cover.refractive_index"]
    assert abs(index.value - true) < 2 * index.sigma


@pytest.mark.slow
def test_unexpected_glass_contradicts_no_number() -> None:
    """Bumps of some 60 um on a fine grid, which the relief's prior holds to be unlikely."""
    uneven = scene(1, views=16, grid=(10, 10), amplitude=1e-5, noise=0.1)
    for settings in (Settings(), Settings(free=(ALL,))):
        resolved, _ = resolve(uneven, uneven.cover, settings)
        assert resolved.fitted.joint
        assert not largest_prior_conflict(resolved.fitted.joint)
        assert not resolved.doubted
