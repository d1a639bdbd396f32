"""The priors that a description gives to a fit, and their form for a doubted number."""

from dataclasses import replace

import numpy as np
import pytest

from calib.estimation.parameters import Parameters
from calib.estimation.stated_priors import priors_of, widen_prior, with_estimates
from calib.optics.build import covered_path
from calib.session.camera import Intrinsics
from calib.session.freeing import free_parameters
from calib.session.numbers import replace_numbers
from calib.session.schema import Number
from fixtures.synthetic import paper_cone

COVER = paper_cone()
FOUND = Intrinsics(
    Number(640.0, 0.2),
    Number(641.0, 0.2),
    Number(416.0, 0.15),
    Number(318.0, 0.12),
    (
        Number(-0.05, 5e-4),
        Number(0.01, 2e-3),
        Number(0.0, 5e-5),
        Number(0.0, 5e-5),
        Number(0.0, 3e-3),
    ),
    (
        (0.99,),
        (0.5, 0.5),
        (0.0,) * 3,
        (-0.2, -0.2, 0.0, 0.0),
        (0.2, 0.2, 0.0, 0.0, -0.937),
        (0.0,) * 6,
        (0.0,) * 7,
        (-0.13, -0.12, 0.0, 0.0, 0.856, -0.975, 0.0, 0.0),
    ),
)


def covariance(intrinsics: Intrinsics) -> np.ndarray:
    """Return the (9, 9) covariance, over the parameters' scales."""
    path, values = covered_path(intrinsics, COVER)
    root = Parameters.of(path, values, priors_of(intrinsics, COVER, path)).free_root()
    return np.asarray(root @ root.T)


def test_each_pair_has_its_names() -> None:
    path, _ = covered_path(FOUND, COVER)
    priors = priors_of(FOUND, COVER, path)
    assert priors.sigmas["camera.k3"] == 3e-3
    assert priors.correlations["camera.fy", "camera.fx"] == 0.99
    assert priors.correlations["camera.k2", "camera.k1"] == -0.937
    assert priors.correlations["camera.k3", "camera.k2"] == -0.975
    assert len(priors.correlations) == 9 * 8 / 2


def test_freeing_the_other_numbers_keeps_correlations() -> None:
    intrinsics, cover = free_parameters(FOUND, COVER, ("all",))
    assert intrinsics == FOUND
    assert cover.parameters["thickness"].sigma > 0


@pytest.mark.parametrize("name", ["camera.fx", "camera.k2", "camera.p1"])
def test_a_doubted_number_makes_the_prior_looser_in_every_direction(name: str) -> None:
    intrinsics, cover = widen_prior(FOUND, COVER, name, 10.0)
    assert cover == COVER
    initial, final = covariance(FOUND), covariance(intrinsics)
    added = final - initial
    place = [
        "camera.fx",
        "camera.fy",
        "camera.cx",
        "camera.cy",
        "camera.k1",
        "camera.k2",
        "camera.p1",
    ].index(name)
    expected = np.zeros_like(added)
    expected[place, place] = 99 * initial[place, place]
    assert np.allclose(added, expected, atol=1e-12 * added.max()), (
        "an independent error is added to it, and to nothing else"
    )


def test_a_doubted_number_of_the_cover_does_not_change_the_camera() -> None:
    cover = replace(COVER, parameters={**COVER.parameters, "thickness": Number(0.003, 1e-4)})
    intrinsics, wider = widen_prior(FOUND, cover, "cover.thickness", 10.0)
    assert intrinsics == FOUND
    assert wider.parameters["thickness"].sigma == pytest.approx(1e-3)


def test_estimates_leave_their_correlations_to_the_covariance() -> None:
    intrinsics, _ = replace_numbers(FOUND, COVER, {})
    assert intrinsics == replace(FOUND, correlations=())


def test_without_a_fit_the_correlations_stay() -> None:
    assert with_estimates(FOUND, COVER, None) == (FOUND, COVER)
