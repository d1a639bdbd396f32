"""Odd arrays and numbers through every call of the library that takes one.

An array of another type, order or stride is an array like another. NaN, infinite and huge places
are answered with NaN. All else is an InputError; nothing warns.
"""

import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from calib import InputError, Measurer, RefracalError, TagLocator, Undistorter, WrongTypeError
from calib.apply.measure import BoardPose
from calib.apply.water import index_of_water
from calib.calibration import MIN_FIELD_POINTS, Calibration
from calib.corners.view import View
from fixtures.known import known
from fixtures.synthetic import scene

W, H = 164, 123
NAN, INF = float("nan"), float("inf")
PIXELS = np.array([[80.0, 60.0], [40.0, 30.0], [100.0, 90.0], [120.0, 70.0]])
POINTS = np.array([[0.0, 0.0, 0.5], [0.1, 0.05, 0.6], [-0.1, 0.05, 0.6], [0.05, -0.1, 0.7]])
DEPTHS = np.array([0.5, 0.6, 0.7, 0.8])
POSE = np.array([0.1, 0.2, 0.05, 0.02, 0.01, 0.5])
TAGS = np.array([[[60.0, 40.0], [90.0, 42.0], [88.0, 70.0], [61.0, 69.0]]] * 2)
COVARIANCES = np.array([0.01 * np.eye(8)] * 2)


@dataclass(frozen=True)
class Library:
    """The objects on which the calls are made."""

    calibration: Calibration
    undistorter: Undistorter
    measurer: Measurer
    locator: TagLocator
    view: View


@pytest.fixture(scope="module")
def library() -> Library:
    made = scene(1, views=1, grid=(4, 4), amplitude=3e-5)
    calibration = known(made, W, H)
    corners = calibration.project(
        np.column_stack([made.board.points() / 2, np.full(made.board.count, 0.5)])
    )
    return Library(
        calibration,
        Undistorter(calibration, 0.5),
        Measurer(calibration),
        TagLocator(calibration, "DICT_APRILTAG_36h11", 0.05),
        View("a.png", corners, np.isfinite(corners[:, 0]).astype(np.float64)),
    )


@dataclass(frozen=True)
class Call:
    """A call and a good array for it."""

    of: Callable[[Library, Any], object]
    good: np.ndarray | float | int
    by_row: bool = False
    """True if each row of what it returns is of the same row of the array."""


def grey(dtype: type = np.uint8) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 255, (H, W)).astype(dtype)


CALLS: Mapping[str, Call] = {
    "Calibration.rays": Call(lambda at, a: at.calibration.rays(a), PIXELS, by_row=True),
    "Calibration.rays of many": Call(
        lambda at, a: at.calibration.rays(a),
        np.tile(PIXELS, (MIN_FIELD_POINTS // 4, 1)),
        by_row=True,
    ),
    "Calibration.project": Call(lambda at, a: at.calibration.project(a), POINTS, by_row=True),
    "Calibration.project of many": Call(
        lambda at, a: at.calibration.project(a),
        np.tile(POINTS, (MIN_FIELD_POINTS // 4, 1)),
        by_row=True,
    ),
    "Calibration.undistort_maps": Call(lambda at, a: at.calibration.undistort_maps(a), 0.5),
    "Undistorter(depth)": Call(lambda at, a: Undistorter(at.calibration, a), 0.5),
    "Undistorter(depth image)": Call(
        lambda at, a: Undistorter(at.calibration, a), np.full((H, W), 0.5)
    ),
    "Undistorter(camera_matrix)": Call(
        lambda at, a: Undistorter(at.calibration, 0.5, camera_matrix=a),
        np.array([[120.0, 0, 82], [0, 120, 61], [0, 0, 1]]),
    ),
    "Undistorter(size)": Call(
        lambda at, a: Undistorter(at.calibration, 0.5, size=a), np.array([64, 48])
    ),
    "Undistorter(crop)": Call(lambda at, a: Undistorter(at.calibration, 0.5, crop=a), 0.5),
    "Undistorter(near)": Call(lambda at, a: Undistorter(at.calibration, 0.5, near=a), 0.1),
    "Undistorter(interpolation)": Call(
        lambda at, a: Undistorter(at.calibration, 0.5, interpolation=a), 1
    ),
    "Undistorter.at": Call(lambda at, a: at.undistorter.at(a), 0.3),
    "Undistorter.at(depth image)": Call(
        lambda at, a: at.undistorter.at(a), np.full((H, W), 0.5, np.float32)
    ),
    "Undistorter.undistort": Call(lambda at, a: at.undistorter.undistort(a), grey()),
    "Undistorter.undistort of colours": Call(
        lambda at, a: at.undistorter.undistort(a), np.dstack([grey()] * 3)
    ),
    "Undistorter.undistort(into)": Call(
        lambda at, a: at.undistorter.undistort(grey(), a), np.zeros((H, W), np.uint8)
    ),
    "Undistorter.undistort_points": Call(
        lambda at, a: at.undistorter.undistort_points(a), PIXELS, by_row=True
    ),
    "Undistorter.undistort_points(depth)": Call(
        lambda at, a: at.undistorter.undistort_points(PIXELS, a), DEPTHS, by_row=True
    ),
    "Undistorter.distort_points": Call(
        lambda at, a: at.undistorter.distort_points(a), PIXELS, by_row=True
    ),
    "Undistorter.distort_points(depth)": Call(
        lambda at, a: at.undistorter.distort_points(PIXELS, a), DEPTHS, by_row=True
    ),
    "Undistorter.project": Call(lambda at, a: at.undistorter.project(a), POINTS, by_row=True),
    "Undistorter.rays": Call(lambda at, a: at.undistorter.rays(a), PIXELS, by_row=True),
    "Measurer(noise_px)": Call(lambda at, a: Measurer(at.calibration, a), 0.1),
    "Measurer.board_pose(corners)": Call(
        lambda at, a: at.measurer.board_pose(replace(at.view, corners=a)), np.zeros(0)
    ),
    "Measurer.board_pose(weight)": Call(
        lambda at, a: at.measurer.board_pose(replace(at.view, weight=a)), np.zeros(0)
    ),
    "BoardPose.exactly": Call(lambda _, a: BoardPose.exactly(a), POSE),
    "BoardPose.facing": Call(lambda _, a: BoardPose.facing(a), 0.5),
    "Measurer.on_planes": Call(
        lambda at, a: at.measurer.on_planes(a, [BoardPose.facing(0.5)], [0] * 4), PIXELS
    ),
    "Measurer.on_planes(pose)": Call(
        lambda at, a: at.measurer.on_planes(PIXELS, [BoardPose.exactly(a)], [0] * 4), POSE
    ),
    "Measurer.on_planes(plane)": Call(
        lambda at, a: at.measurer.on_planes(PIXELS, [BoardPose.exactly(POSE)] * 2, a),
        np.array([0, 1, 1, 0]),
    ),
    "Measurer.triangulate": Call(
        lambda at, a: at.measurer.triangulate(a, boards(), [0, 1, 0, 1], [0, 0, 1, 1]), PIXELS
    ),
    "Measurer.triangulate(board)": Call(
        lambda at, a: at.measurer.triangulate(PIXELS, boards(), a, [0, 0, 1, 1]),
        np.array([0, 1, 0, 1]),
    ),
    "Measurer.triangulate(point)": Call(
        lambda at, a: at.measurer.triangulate(PIXELS, boards(), [0, 1, 0, 1], a),
        np.array([0, 0, 1, 1]),
    ),
    "MeasuredPoints.distance": Call(
        lambda at, a: at.measurer.on_planes(PIXELS, boards()[:1], [0] * 4).distance(0, a), 1
    ),
    "TagLocator(side)": Call(
        lambda at, a: TagLocator(at.calibration, "DICT_APRILTAG_36h11", a), 0.05
    ),
    "TagLocator(side_sigma)": Call(
        lambda at, a: TagLocator(at.calibration, "DICT_APRILTAG_36h11", 0.05, a), 0.001
    ),
    "TagLocator(border)": Call(
        lambda at, a: TagLocator(at.calibration, "DICT_APRILTAG_36h11", 0.05, border=a), 1
    ),
    "TagLocator(dictionary)": Call(lambda at, a: TagLocator(at.calibration, a, 0.05), 0),
    "TagLocator.locate": Call(lambda at, a: at.locator.locate(a), grey()),
    "TagLocator.place": Call(lambda at, a: at.locator.place(a, COVARIANCES), TAGS),
    "TagLocator.place(covariances)": Call(lambda at, a: at.locator.place(TAGS, a), COVARIANCES),
    "index_of_water(salinity)": Call(lambda _, a: index_of_water(a, 15.0), 35.0),
    "index_of_water(temperature)": Call(lambda _, a: index_of_water(35.0, a), 15.0),
    "index_of_water(wavelength)": Call(lambda _, a: index_of_water(35.0, 15.0, a), 550.0),
}
"""Every call that takes an array or a number of a person's program, by its name."""
each_call = pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow if name == "TagLocator.locate" else ())
        for name in CALLS
    ],
)


def boards() -> list[BoardPose]:
    return [BoardPose.exactly(POSE), BoardPose.exactly(POSE + np.array([0.1, 0, 0, 0.05, 0, 0.1]))]


def good(name: str, library: Library) -> np.ndarray | float | int:
    """The good array of a call; a view's own are only known with the calibration."""
    if name.startswith("Measurer.board_pose"):
        return library.view.weight if "weight" in name else library.view.corners
    return CALLS[name].good


def alike(array: np.ndarray) -> dict[str, Any]:
    """The same numbers in other arrays."""
    wider = np.repeat(array, 2, axis=0)
    locked = array.copy()
    locked.setflags(write=False)
    return {
        "reversed strides": np.ascontiguousarray(array[::-1])[::-1],
        "every second row": wider[::2],
        "column by column": np.asfortranarray(array),
        "the other byte order": array.astype(array.dtype.newbyteorder()),
        "read-only": locked,
        "a list": array.tolist(),
        "a tuple": tuple(array.tolist()),
        "a subclass": array.view(np.ma.MaskedArray),
    }


def odd(array: np.ndarray) -> dict[str, Any]:
    """Arrays of other shapes, kinds and contents."""
    values = [NAN, INF, -INF, 1e308, -1e308, 1e-308, 1e20, 0.0, -1.0, -5e5]
    real = array.astype(np.float64)
    copies = []
    for value in values:
        changed = real.copy()
        changed.flat[0] = value
        copies.append(changed)
    return {
        **{f"one is {value}": copy for value, copy in zip(values, copies, strict=True)},
        **{f"all are {value}": np.full_like(real, value) for value in values},
        "int8": np.clip(real, 0, 100).astype(np.int8),
        "int64": np.nan_to_num(real).astype(np.int64),
        "float16": real.astype(np.float16),
        "float32": real.astype(np.float32),
        "long double": np.full(array.shape, np.longdouble("1e4000")),
        "bool": real > 0.5,
        "complex": real + 1j,
        "text": array.astype(str),
        "objects": array.astype(object),
        "None": None,
        "a word": "x",
        "bytes": b"x",
        "a mapping": {},
        "nothing": [],
        "no rows": array[:0],
        "no columns": array[..., :0],
        "one row": array[:1],
        "one row less": array[:-1],
        "one column less": array[..., :-1],
        "one number": 7.0,
        "a large number": 10**400,
        "flat": array.reshape(-1),
        "turned": array.T,
        "one more dimension": array[None],
        "ragged": [[1.0, 2.0], [3.0]],
        "of None": [None, None],
        "dates": np.zeros(array.shape, "M8[s]"),
        "records": np.zeros(array.shape, [("x", "f8")]),
    }


def cases(array: np.ndarray) -> dict[str, Any]:
    """Everything that is tried in the place of a good array or number."""
    if array.ndim:
        return odd(array) | alike(array)
    arrays = odd(array[None])
    first = {
        f"{kind}, one number": np.ravel(np.asarray(value, object))[0]
        for kind, value in arrays.items()
        if kind != "ragged" and np.size(np.asarray(value, object))
    }
    return arrays | first


def answer(call: Call, library: Library, value: Any) -> object:
    """Return the result of the call, or the sentence of its refusal; raise anything else."""
    with warnings.catch_warnings(action="error"):
        try:
            return call.of(library, value)
        except RefracalError as error:
            return error


def numbers_of(result: object) -> list[np.ndarray]:
    pieces = result if isinstance(result, tuple) else (result,)
    return [array for array in pieces if isinstance(array, np.ndarray)]


@each_call
def test_any_argument_is_answered_or_refused_in_a_sentence(name: str, library: Library) -> None:
    array = np.asarray(good(name, library))
    wrong = []
    for kind, value in (
        (odd(array) | alike(array)).items() if array.ndim else odd(array[None]).items()
    ):
        cases = [value] if array.ndim else [value, *np.ravel(np.asarray(value, object))[:1]]
        for case in cases:
            try:
                answer(CALLS[name], library, case)
            except Exception as error:
                wrong.append(f"{kind}: {type(error).__name__} {str(error)[:120]}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", [name for name, call in CALLS.items() if call.by_row])
def test_an_array_is_the_same_in_another_order_or_type(name: str, library: Library) -> None:
    call, array = CALLS[name], np.asarray(CALLS[name].good)
    expected = numbers_of(call.of(library, array))
    assert all(np.isfinite(numbers).all() for numbers in expected)
    for kind, value in alike(array).items():
        for numbers, wanted in zip(numbers_of(answer(call, library, value)), expected, strict=True):
            np.testing.assert_array_equal(numbers, wanted, err_msg=kind)
    rounded = np.round(array)
    if np.isfinite(numbers_of(call.of(library, rounded))[0]).all():
        for numbers, wanted in zip(
            numbers_of(answer(call, library, rounded.astype(np.int16))),
            numbers_of(call.of(library, rounded)),
            strict=True,
        ):
            np.testing.assert_array_equal(numbers, wanted, err_msg="whole numbers")


@pytest.mark.parametrize("name", [name for name, call in CALLS.items() if call.by_row])
@pytest.mark.parametrize("value", [NAN, INF, -INF])
def test_only_rows_without_a_result_are_nan(name: str, value: float, library: Library) -> None:
    call, array = CALLS[name], np.array(CALLS[name].good)
    if value == INF and "depth" in name:
        return  # the farthest depth there is
    expected = numbers_of(call.of(library, array))
    array[1, ...] = value
    for numbers, wanted in zip(numbers_of(answer(call, library, array)), expected, strict=True):
        assert np.isnan(numbers[1]).all()
        np.testing.assert_allclose(np.delete(numbers, 1, 0), np.delete(wanted, 1, 0), atol=1e-9)


def test_a_wrong_shape_is_refused_with_the_expected_one(library: Library) -> None:
    for name, says in (
        ("Calibration.rays", r"pixels has shape \(4,\) where \(N, 2\) is expected"),
        ("Calibration.project", r"points has shape \(4,\) where \(N, 3\) is expected"),
    ):
        with pytest.raises(InputError, match=says):
            CALLS[name].of(library, np.zeros(4))
    with pytest.raises(InputError, match=r"depth has shape \(5,\) where \(4,\) is expected"):
        library.undistorter.undistort_points(PIXELS, np.ones(5))
    with pytest.raises(InputError, match="the picture has pixels of int32: give uint8, uint16 or"):
        library.undistorter.undistort(grey(np.int32))
    with pytest.raises(WrongTypeError, match="the picture is of type NoneType: pass an array of"):
        library.undistorter.undistort(None)  # type: ignore[arg-type]


def test_points_that_are_not_seen_can_be_handed_back(library: Library) -> None:
    distant = library.undistorter.undistort_points(np.array([[-1e6, 5.0], [80.0, 60.0]]))
    assert np.isnan(distant[0]).all()
    back = library.undistorter.distort_points(distant)
    assert np.isnan(back[0]).all()
    np.testing.assert_allclose(back[1], [80.0, 60.0], atol=1e-5)


def test_a_point_as_far_as_numbers_go_is_at_infinity(library: Library) -> None:
    direction = np.array([0.1, 0.05, 1.0])
    far, farther, farthest = library.calibration.project(
        direction * np.array([1e9, 1e15, 1e307])[:, None]
    )
    np.testing.assert_allclose(farther, far, atol=1e-6)
    np.testing.assert_allclose(farthest, far, atol=1e-6)


def test_a_camera_matrix_that_shows_far_more_than_the_camera_sees_is_refused(
    library: Library,
) -> None:
    for focal in (1.0, 1e-3, 1e-300):
        with pytest.raises(InputError, match=r"give focal lengths of \d+ px or more") as caught:
            Undistorter(library.calibration, 0.5, camera_matrix=np.diag([focal, focal, 1.0]))
    smallest = float(str(caught.value).partition("lengths of ")[2].split()[0])
    matrix = np.array([[smallest, 0, W / 2], [0, smallest, H / 2], [0, 0, 1.0]])
    assert Undistorter(library.calibration, 0.5, camera_matrix=matrix).size == (W, H)
