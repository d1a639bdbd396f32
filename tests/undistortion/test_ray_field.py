"""Maps against tracing, pixel by pixel."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from calib.apply.asked_depths import (
    ReachedDepths,
    describe_all,
    describe_depths,
    describe_unsupported,
)
from calib.errors import InputError
from calib.optics.build import pinhole_path
from calib.optics.exposure import MIDDLE
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.projection import project
from calib.session.camera import Intrinsics
from calib.session.schema import Number
from calib.undistortion.depth_map import DepthMap
from calib.undistortion.inverse import invert
from calib.undistortion.ray_field import RayField, ray_field
from fixtures.known import known
from fixtures.synthetic import HEIGHT, WIDTH, Scene, scene


@pytest.fixture(scope="module")
def made() -> Scene:
    return scene(1, views=1, grid=(8, 8), amplitude=3e-5)


@pytest.fixture(scope="module")
def field(made: Scene) -> RayField:
    return ray_field(made.path, made.values, WIDTH, HEIGHT)


def some_pixels(count: int) -> np.ndarray:
    border = [
        [0, 0],
        [WIDTH - 1, 0],
        [0, HEIGHT - 1],
        [WIDTH - 1, HEIGHT - 1],
        [WIDTH - 1, HEIGHT // 2],
        [WIDTH // 2, 0],
    ]
    return np.vstack(
        [np.random.default_rng(0).integers([0, 0], [WIDTH, HEIGHT], (count, 2)), border]
    )


@pytest.mark.parametrize("depth", [0.1, 0.5, 5.0])
def test_map_agrees_with_tracing(made: Scene, field: RayField, depth: float) -> None:
    made_map = field.map_at(depth)
    assert made_map.x.shape == made_map.valid.shape == (HEIGHT, WIDTH)
    assert made_map.x.dtype == np.float32
    pixels = some_pixels(3000)
    v = {name: float(made.values[f"camera.{name}"]) for name in ("fx", "fy", "cx", "cy")}
    tangents = (pixels - [v["cx"], v["cy"]]) / [v["fx"], v["fy"]]
    points = np.column_stack([tangents * depth, np.full(len(pixels), depth)])
    traced = project(made.path, made.values, torch.from_numpy(points), MIDDLE).numpy()
    in_picture = (
        np.abs(traced - [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]) <= [WIDTH / 2, HEIGHT / 2]
    ).all(-1)
    column, row = pixels.T
    mapped = np.column_stack([made_map.x[row, column], made_map.y[row, column]])
    clear = (
        np.abs(np.abs(traced - [(WIDTH - 1) / 2, (HEIGHT - 1) / 2]) - [WIDTH / 2, HEIGHT / 2])
        > 0.01
    ).all(-1)
    assert (made_map.valid[row, column] == in_picture)[clear].all()
    assert in_picture.mean() > 0.9
    assert np.abs(mapped - traced)[in_picture & clear].max() < 0.01
    assert (mapped[~in_picture & clear] == -1).all()


def test_field_is_enough_for_any_depth(made: Scene, field: RayField) -> None:
    """A and B at the nodes, without the model: where the ray of each node meets depth Z, seen by
    the bare pinhole.
    """
    rays = made.path.trace(
        torch.from_numpy(np.stack(np.meshgrid(field.nodes_x, field.nodes_y), -1).reshape(-1, 2)),
        made.values,
        MIDDLE,
    )
    v = {name: float(made.values[f"camera.{name}"]) for name in ("fx", "fy", "cx", "cy")}
    for depth in (0.1, 0.37, 20.0):
        met = rays.at_depth(torch.tensor(depth, dtype=torch.float64)).numpy() / depth
        expected = met * [v["fx"], v["fy"]] + [v["cx"], v["cy"]]
        assert (
            np.abs((field.at_infinity + field.parallax / depth).reshape(-1, 2) - expected).max()
            < 1e-9
        )


def test_the_map_is_invalid_where_no_ray_leaves_the_cover(made: Scene) -> None:
    """A bump so steep that light is totally reflected on its flanks, by a small camera: the cost
    goes with its area.
    """
    values = {**made.values, "relief.amplitudes": made.values["relief.amplitudes"].clone()}
    values["relief.amplitudes"][1, 1] = 3e-3
    values["cover.refractive_index"] = torch.tensor(2.6, dtype=torch.float64)
    for name in ("fx", "fy", "cx", "cy"):
        values[f"camera.{name}"] = made.values[f"camera.{name}"] / 3
    field = ray_field(made.path, values, WIDTH // 6, HEIGHT // 6)
    made_map = field.map_at(1.0)
    assert 0.5 < field.valid.mean() < 1
    assert np.isfinite(field.at_infinity).all()
    assert 0.05 < made_map.valid.mean() < 1
    error, in_picture, valid = off_projection(made.path, values, made_map, 2)
    assert (in_picture & valid).sum() > 500
    assert error[in_picture & valid].max() < 0.01


@pytest.mark.parametrize("depth", [0.0, -1.0, float("nan")])
def test_an_invalid_depth_is_refused(field: RayField, depth: float) -> None:
    with pytest.raises(InputError, match="write metres above 0"):
        field.map_at(depth)


@pytest.mark.parametrize("depth", [9e-4, 1e-300, 2e-3, 0.01])
def test_a_depth_inside_the_lens_or_its_cover_is_refused(field: RayField, depth: float) -> None:
    with pytest.raises(InputError, match="too near"):
        field.map_at(depth)


def off_projection(
    path: Path, values: Values, made: DepthMap, step: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return for every so many pixels the distance (px) between map and projection, whether the
    projection lies in the picture, and whether the map is valid.
    """
    height, width = made.valid.shape
    rows, columns = np.mgrid[0:height:step, 0:width:step].reshape(2, -1)
    fx = float(values[f"camera.{'fx'}"])
    fy = float(values[f"camera.{'fy'}"])
    cx = float(values[f"camera.{'cx'}"])
    cy = float(values[f"camera.{'cy'}"])
    points = (
        np.column_stack([(columns - cx) / fx, (rows - cy) / fy, np.ones(len(rows))]) * made.depth
    )
    projected = project(path, values, torch.from_numpy(points), MIDDLE).numpy()
    in_picture = (
        np.abs(projected - [(width - 1) / 2, (height - 1) / 2]) < [width / 2, height / 2]
    ).all(-1)
    error = np.hypot(
        made.x[rows, columns] - projected[:, 0], made.y[rows, columns] - projected[:, 1]
    )
    return error, in_picture, made.valid[rows, columns]


@pytest.mark.parametrize("depth", [0.014, 0.03])
def test_nearby_a_map_is_right_or_not_valid(made: Scene, field: RayField, depth: float) -> None:
    error, in_picture, valid = off_projection(made.path, made.values, field.map_at(depth), 24)
    assert error[in_picture & valid].max(initial=0) < 0.01
    assert not valid[np.isnan(error)].any(), "no ray reaches that point"
    assert valid.any()


def lens_path(*coefficients: float) -> tuple[Path, Values]:
    return pinhole_path(
        Intrinsics(
            Number(335.0),
            Number(335.0),
            Number(342.0),
            Number(231.0),
            tuple(map(Number, coefficients)),
        )
    )


def test_a_wide_rational_lens_is_held_to_a_hundredth_of_a_pixel() -> None:
    path, values = lens_path(0.9, 0.1, 3e-4, 7e-4, 0.002, 1.2, 0.3, 0.015)
    error, in_picture, valid = off_projection(
        path, values, ray_field(path, values, 640, 480).map_at(1.0), 3
    )
    assert in_picture.all()
    assert valid.all()
    assert error.max() < 0.01


def test_around_a_pole_of_the_lens_the_map_is_right_or_not_valid() -> None:
    """Zhang's method with eight coefficients may fit a pole and a zero that nearly cancel, here
    about 300 px from the middle.
    """
    path, values = lens_path(-0.074, -0.30661, 3e-4, 7e-4, -0.01694, 0.28435, -0.42004, -0.08308)
    field = ray_field(path, values, 640, 480)
    error, in_picture, valid = off_projection(path, values, field.map_at(1.0), 2)
    assert not field.valid.all()
    assert error[in_picture & valid].max() < 0.01
    assert valid.mean() > 0.99


def test_a_map_is_valid_exactly_where_the_camera_sees() -> None:
    """With a lens whose straight picture is much smaller than the camera's, so that the grid of the
    inverse fails around what it sees.
    """
    path, values = lens_path(0.5, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    field = ray_field(path, values, 640, 480)
    assert not invert(field.forward(1.0), field.window).cells.all()
    error, in_picture, valid = off_projection(path, values, field.map_at(1.0), 1)
    assert np.count_nonzero(valid != in_picture) <= 20, "pixels at the border, by 0.01 px"
    assert error[in_picture & valid].max() < 0.01
    assert 0.3 < valid.mean() < 0.9


def test_the_border_of_what_a_lens_sees_is_smooth() -> None:
    """A lens that folds within the picture is accurate up to about a circle. The cells of the field
    are squares of 2 px: as a border, they make steps of 2.8 px in its radius.
    """
    field = ray_field(*lens_path(-0.35, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), 640, 480)
    angles = np.linspace(0, 2 * np.pi, 721)[:, None]
    radii = np.arange(120, 225, 0.05)
    cx, cy = 342.0, 231.0
    visible = field.sees(cx + radii * np.cos(angles), cy + radii * np.sin(angles), 1.0)
    assert visible[:, 0].all()
    assert not visible[:, -1].any()
    border = radii[np.argmin(visible, 1)]
    step = np.abs(np.diff(border)).max()
    assert step < 0.5


def test_a_depth_that_the_boards_do_not_support_gets_a_sentence(made: Scene) -> None:
    calibration = known(made, WIDTH, HEIGHT)
    assert not list(describe_unsupported(calibration, [9.0])), "no corner is known"
    visible = replace(calibration, corners_at=np.array([[10.0, 10.0, 0.5], [90.0, 90.0, 0.8]]))
    assert not list(describe_unsupported(visible, [0.45, 1.0]))
    (sentence,) = describe_unsupported(visible, [0.3, 0.5, 9.0])
    assert sentence.startswith("Take care at 0.3 m, 9 m: the boards were 0.5 to 0.8 m away")


def test_a_depth_in_centimetres_gets_a_sentence(made: Scene) -> None:
    calibration = known(made, WIDTH, HEIGHT)
    assert not list(describe_depths(calibration, [60.0])), "no corner is known"
    near = replace(calibration, corners_at=np.array([[10.0, 10.0, 0.5], [90.0, 90.0, 0.8]]))
    (remark,) = describe_depths(near, [9.9, 60.0])
    assert remark == "60 is taken as metres: write 0.6 for 60 cm, and inf for far away."
    far = replace(near, corners_at=near.corners_at * [1, 1, 10])
    assert not list(describe_depths(far, [60.0])), "the boards were 8 m away"


def test_a_depth_inside_of_the_cover_is_refused(made: Scene, field: RayField) -> None:
    """The cover is nearer at the picture's edges, so a depth between is a part of the picture."""
    assert field.hidden_fraction(0.5) == 0.0
    assert field.hidden_fraction(1e-3) == 1.0
    on_image = field.nearest[field.valid]
    between = float(np.median(on_image))
    assert 0.05 < field.hidden_fraction(between) < 0.95
    calibration = known(made, WIDTH, HEIGHT)
    (remark,) = describe_depths(calibration, [0.5, between])
    assert remark.startswith(f"At {between:g} m, ")
    (remark,) = describe_depths(calibration, [99, 500, np.inf])
    assert remark == "500 is taken as metres: write 0.5 for 500 mm, and inf for far away."
    with pytest.raises(InputError, match=r"depth 0\.002 m is too near: write 0\.0\d+ m or more"):
        field.map_at(0.002)
    with pytest.raises(InputError, match=r"depth 0\.002 m is too near"):
        next(describe_all(calibration, [between, 0.002]))  # no sentence comes before the error
    reached = ReachedDepths.of(field, [0.5, 0.002])
    assert reached.depths == (0.5,)
    assert len(reached.refusals) == 1
