"""The check names a change and its size on simulated pictures, and does not take anything else for
a change of the camera.
"""

import pytest

from calib.apply.change_medium import replace_medium
from calib.checking.check import Checker
from calib.checking.hypotheses import FORGOTTEN_IN_WATER
from calib.checking.pictures import Pictures
from calib.checking.result import CheckStatus
from calib.session.schema import Number
from fixtures.later import NOISE, Later, camera, mirrored, shaken, uncovered, zoomed
from tests.checking.conftest import Made

CASES = (
    pytest.param("cone", "focal", marks=pytest.mark.slow),
    pytest.param("dome", "principal_point", marks=pytest.mark.slow),
    pytest.param("flat", "lens", marks=pytest.mark.slow),
    pytest.param("dome", "board_scale", marks=pytest.mark.slow),
    ("cone", "board_shape"),
    pytest.param("flat", "wedge", marks=pytest.mark.slow),
)


@pytest.mark.parametrize(("shape", "kind"), CASES)
def test_a_change_is_named_with_its_size(cameras: Made, shape: str, kind: str) -> None:
    """Ten times the smallest size that moves a corner by the noise."""
    made, checker = cameras[shape]
    change = next(change for change in checker.changes if change.name == kind)
    later = Later.drawn(made, change, 102, 4)
    assert later.possible(10)
    result = checker.check(Pictures(later.views(10), made.board))
    assert result.status is not CheckStatus.VALID
    assert result.statistics
    assert result.statistics.p_value < 1e-6
    assert result.changes[0].name == kind
    for name, value, sigma, _ in result.changes[0].parameters:
        assert abs(value - 10 * float(later.direction[name])) < 5 * sigma, name


@pytest.mark.slow
def test_pictures_of_twice_the_zoom_come_from_another_mode(cameras: Made) -> None:
    made, checker = cameras["flat"]
    later = Later.drawn(made, None, 103, 3)
    result = checker.check(Pictures(zoomed(later.views()), made.board))
    (change,) = result.changes
    assert (result.status, change.name) == (CheckStatus.BROKEN, "picture_mode")
    assert change.value is not None
    assert change.sigma is not None
    assert abs(change.value - 2) < 5 * change.sigma
    assert change.sigma < 0.01


@pytest.mark.parametrize(
    ("across", "down"),
    [
        pytest.param(1, 4 / 3, marks=pytest.mark.slow),
        pytest.param(0.75, 1, marks=pytest.mark.slow),
        pytest.param(2, 1.1, marks=pytest.mark.slow),
    ],
)
def test_stretched_pictures_are_named_with_the_figure(
    cameras: Made, across: float, down: float
) -> None:
    made, checker = cameras["flat"]
    later = Later.drawn(made, None, 103, 3)
    result = checker.check(Pictures(zoomed(later.views(), across, down), made.board))
    (change,) = result.changes
    assert (result.status, change.name) == (CheckStatus.BROKEN, "stretched_mode")
    assert change.value is not None
    assert change.sigma is not None
    assert abs(change.value - down / across) < 5 * change.sigma
    assert change.sigma < 0.01
    assert result.statistics
    assert result.statistics.noise_ratio < 1.5


@pytest.mark.slow
def test_mirrored_pictures_are_reported(cameras: Made) -> None:
    made, checker = cameras["cone"]
    later = Later.drawn(made, None, 104, 3)
    result = checker.check(Pictures(mirrored(later.views(), made.board), made.board))
    assert result.status is CheckStatus.BROKEN
    assert str(result.changes[0]) == "the pictures come from another mode: mirrored, they fit"


@pytest.mark.parametrize("shape", [pytest.param("cone", marks=pytest.mark.slow), "flat"])
def test_a_cover_that_was_forgotten_is_no_thinner_glass(cameras: Made, shape: str) -> None:
    made, checker = cameras[shape]
    result = checker.check(Pictures(Later.drawn(uncovered(made), None, 107, 4).views(), made.board))
    assert (result.status, [change.name for change in result.changes]) == (
        CheckStatus.BROKEN,
        ["no_cover"],
    )


def test_pictures_without_a_cover_may_also_be_in_air() -> None:
    made, calibration = camera("flat", 3)
    checker = Checker.of(replace_medium(calibration, Number(1.333)))
    result = checker.check(Pictures(Later.drawn(uncovered(made), None, 107, 4).views(), made.board))
    (change,) = result.changes
    assert change.name == "no_cover"
    assert change.words == FORGOTTEN_IN_WATER


@pytest.mark.slow
def test_a_bad_view_is_left_out_and_the_others_answer(cameras: Made) -> None:
    made, checker = cameras["cone"]
    later = Later.drawn(made, None, 105, 4)
    result = checker.check(Pictures(shaken(later.views(), 1), made.board))
    assert result.status is CheckStatus.VALID
    assert result.statistics
    assert result.statistics.views == 3
    assert [item.name for item in result.rejected] == [later.views()[0].name]
    assert "alone does not fit" in result.rejected[0].reason


def test_noise_alone_is_no_change(cameras: Made) -> None:
    """Pictures in poor light: three times the noise, which is told."""
    made, checker = cameras["cone"]
    result = checker.check(
        Pictures(Later.drawn(made, None, 106, 4).views(noise=3 * NOISE), made.board)
    )
    assert result.status is CheckStatus.VALID
    assert result.statistics
    assert result.statistics.noise_ratio == pytest.approx(3, rel=0.2)


def test_an_unchanged_camera_is_valid(cameras: Made) -> None:
    for made, checker in cameras.values():
        for seed in range(3):
            result = checker.check(
                Pictures(Later.drawn(made, None, 200 + seed, 3).views(), made.board)
            )
            assert result.status is CheckStatus.VALID
            assert result.statistics
            assert result.statistics.error_px < result.statistics.allowed_px
