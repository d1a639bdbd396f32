"""Maps that change while the stream runs: the old ones serve until the new are ready."""

import threading

import numpy as np
import pytest

from calib.apply.undistorter import Undistorter
from calib.calibration import Calibration
from calib.errors import InputError
from capture.streaming.straightener import Straightener
from capture.streaming.view import StreamView
from tests.capture.streaming.listening import HANGS_S


def test_pictures_are_the_undistorter_s_and_share_a_buffer(
    calibration: Calibration, pictures: list[np.ndarray]
) -> None:
    straightener = Straightener(calibration, StreamView(0.5))
    for picture in (pictures[0], pictures[1][..., 0]):
        straight = straightener.straighten(picture)
        expected = StreamView(0.5).undistorter(calibration).undistort(picture)
        np.testing.assert_array_equal(straight, expected)
    assert straightener.straighten(pictures[0]) is straightener.straighten(pictures[1])


@pytest.mark.parametrize(
    "values", [{"depth": 0.2}, {"crop": 0.0}, {"scale": 0.5}, {"depth": 3.0, "crop": 1.0}]
)
def test_a_change_gives_the_pictures_of_the_new_view(
    calibration: Calibration, pictures: list[np.ndarray], values: dict[str, object]
) -> None:
    straightener = Straightener(calibration, StreamView(0.5))
    straightener.change(values)
    straightener.wait()
    view = StreamView(0.5).changed(values)
    assert straightener.view == view
    expected = view.undistorter(calibration).undistort(pictures[0])
    np.testing.assert_array_equal(straightener.straighten(pictures[0]), expected)


def test_the_old_maps_serve_until_the_new_ones_are_ready_and_only_the_last_change_counts(
    calibration: Calibration, pictures: list[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    began = threading.Event()
    proceed = threading.Event()
    depths: list[object] = []

    def at(self: Undistorter, depth: float) -> Undistorter:
        depths.append(depth)
        began.set()
        assert proceed.wait(HANGS_S)
        return Undistorter(self.calibration, depth)

    monkeypatch.setattr(Undistorter, "at", at)
    straightener = Straightener(calibration, StreamView(0.5))
    before = straightener.straighten(pictures[0]).copy()
    straightener.change({"depth": 1.0})
    assert began.wait(HANGS_S)
    for depth in (2.0, 3.0, 4.0):
        straightener.change({"depth": depth})
    assert straightener.requested == StreamView(4.0)
    assert straightener.view == StreamView(0.5)
    np.testing.assert_array_equal(straightener.straighten(pictures[0]), before)
    proceed.set()
    straightener.wait()
    assert depths == [1.0, 4.0]
    assert straightener.view == straightener.requested == StreamView(4.0)


def test_maps_that_cannot_be_made_are_reported_and_the_old_ones_stay(
    calibration: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    sentences: list[str] = []
    straightener = Straightener(calibration, StreamView(0.5), tell=sentences.append)

    def at(*_: object) -> Undistorter:
        raise InputError("no ray reaches it.")

    monkeypatch.setattr(Undistorter, "at", at)
    straightener.change({"depth": 0.001})
    straightener.wait()
    assert sentences == ["no ray reaches it."]
    assert straightener.problem == "no ray reaches it."
    assert straightener.view == straightener.requested == StreamView(0.5)


def test_a_fixed_size_stays(calibration: Calibration) -> None:
    straightener = Straightener(calibration, StreamView(0.5), fixed_size=True)
    with pytest.raises(InputError, match=r"start it again with --scale 0\.5"):
        straightener.change({"scale": 0.5})
    straightener.change({"depth": 0.4, "crop": 0.0})
    straightener.wait()
    assert straightener.view == StreamView(0.4, 0.0)


def test_a_frame_of_another_size_is_refused(calibration: Calibration) -> None:
    straightener = Straightener(calibration, StreamView(0.5))
    with pytest.raises(InputError, match="64x48 px where the calibration is for 328x246"):
        straightener.straighten(np.zeros((48, 64), np.uint8))
