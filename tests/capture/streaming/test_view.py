"""The view of a stream: its limits, and what its scale does to a picture."""

import numpy as np
import pytest

from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.errors import InputError
from capture.streaming.view import StreamView
from tests.capture.streaming.conftest import SIZE

PIXELS = np.array([[80.0, 60.0], [200.0, 150.0], [164.0, 122.0]])


def test_the_plain_view_is_that_of_the_undistorter(calibration: Calibration) -> None:
    ours = StreamView(0.5).undistorter(calibration)
    plain = Undistorter(calibration, 0.5)
    assert ours.size == SIZE
    np.testing.assert_allclose(ours.camera_matrix, plain.camera_matrix, atol=1e-9)
    for pair in zip(ours.maps, plain.maps, strict=True):
        np.testing.assert_allclose(*pair, atol=1e-3)


@pytest.mark.parametrize("scale", [0.5, 2.0])
def test_a_scale_moves_a_pixel_as_cv2_resize_does(calibration: Calibration, scale: float) -> None:
    """The middle of the top-left pixel is (0, 0), before and after."""
    plain = StreamView(0.5).undistorter(calibration).undistort_points(PIXELS)
    scaled = StreamView(0.5, scale=scale).undistorter(calibration)
    assert scaled.size == (2 * round(SIZE[0] * scale / 2), 2 * round(SIZE[1] * scale / 2))
    factors = np.array(scaled.size) / SIZE
    expected = (plain + 0.5) * factors - 0.5
    np.testing.assert_allclose(scaled.undistort_points(PIXELS), expected, atol=1e-6)


def test_a_crop_shows_valid_pixels_only(calibration: Calibration) -> None:
    assert not StreamView(0.1).undistorter(calibration).valid.all()
    cropped = StreamView(0.1, crop=0.0, scale=0.5).undistorter(calibration)
    assert cropped.size == (164, 124)
    assert cropped.valid.all()


@pytest.mark.parametrize("scale", [0.05, 0.333, 0.5051, 1.013])
def test_sizes_are_even(calibration: Calibration, scale: float) -> None:
    size = StreamView(1.0, scale=scale).size(calibration)
    assert not any(side % 2 for side in size)
    assert min(size) >= 2


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"depth": 0}, "depth is 0: write metres above 0"),
        ({"depth": float("nan")}, "depth is nan: write metres above 0"),
        ({"depth": "1"}, "depth is '1': give a real number"),
        ({"crop": 1.5}, "crop is 1.5: write 0 for valid pixels only"),
        ({"scale": None}, "scale is None: give a real number"),
        ({"scale": 0.01}, "scale is 0.01: write a number from 0.05 to 4"),
        ({"zoom": 1}, "zoom is not of a view: write depth, crop, scale"),
    ],
)
def test_an_impossible_change_is_one_sentence(values: dict[str, object], sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        StreamView(1.0).changed(values)


def test_a_change_keeps_the_other_numbers() -> None:
    view = StreamView(1.0, 0.5, 2.0)
    assert view.changed({"depth": 3}) == StreamView(3.0, 0.5, 2.0)
    assert view.changed({"crop": None}) == StreamView(1.0, None, 2.0)
