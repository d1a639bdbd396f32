"""The border of a straight picture that shows nothing, and the crop that leaves it out."""

import pytest

from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.undistortion.crop import has_black_border
from fixtures.known import known, lens_alone
from fixtures.synthetic import scene

SIZE = (410, 308)


@pytest.fixture(scope="module")
def behind_glass() -> Calibration:
    return known(scene(1, views=1, grid=(8, 8), amplitude=3e-5), *SIZE)


@pytest.mark.parametrize("depth", [0.15, 0.5, 3.0])
def test_a_border_is_reported_where_the_picture_has_one(
    behind_glass: Calibration, depth: float
) -> None:
    is_bordered = not Undistorter(behind_glass, depth).valid.all()
    assert is_bordered
    assert has_black_border(behind_glass.ray_field(), depth)
    assert Undistorter(behind_glass, depth, crop=0.0).valid.all()


@pytest.mark.parametrize(("k1", "is_bordered"), [(-0.2, False), (0.0, False), (0.2, True)])
def test_a_lens_alone_has_a_border_if_it_bends_inwards(k1: float, is_bordered: bool) -> None:
    """A barrel lens sees more than its straight picture shows, a pincushion lens less."""
    lens = (320.0, 320.0, 204.5, 153.5, k1, 0.0, 0.0, 0.0)
    calibration = lens_alone(scene(1, views=1), *SIZE, *lens)
    assert (not Undistorter(calibration, 1.0).valid.all()) == is_bordered
    assert has_black_border(calibration.ray_field(), 1.0) == is_bordered


def test_where_nothing_is_seen_no_crop_is_proposed(behind_glass: Calibration) -> None:
    assert not has_black_border(behind_glass.ray_field(), 0.005)
