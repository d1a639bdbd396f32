"""Effects on the board, each against an oracle that was built without it."""

from dataclasses import replace

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from calib.corners.view import View
from calib.effects.board_flex import BoardFlex
from calib.effects.board_scale import BoardScale
from calib.effects.board_shape import BoardShape
from calib.effects.effect import Effect, EffectContext
from calib.effects.free_field import FreeField
from calib.effects.screen_glass import ScreenGlass
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.estimation.priors import NONE
from calib.estimation.residuals import residuals
from calib.optics.build import pinhole_path
from calib.optics.exposure import MIDDLE
from calib.session.board import Board
from calib.session.point_target import PointTarget
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH
from tests.effects.rays import Array, pinhole, projected, waves
from tests.optics import oracle

BOARD = Board(9, 7, 0.02)
POSE = np.array([0.5, -0.6, 0.2, -0.03, 0.02, 0.4])


POINTS = PointTarget.of(BOARD.points())


def proposed(kind: type[Effect]) -> Effect:
    path, values = pinhole_path(INTRINSICS)
    return kind.propose(EffectContext(BOARD, WIDTH, HEIGHT, path, values))[0]


def proposed_for(board: Board) -> tuple[Effect, ...]:
    path, values = pinhole_path(INTRINSICS)
    return ScreenGlass.propose(EffectContext(board, WIDTH, HEIGHT, path, values))


def land(effect: Effect, pixels: Array, parameters: dict[str, float | Array]) -> Array:
    """(N, 2) m where pixels land on the board at POSE."""
    path, values = pinhole_path(INTRINSICS)
    model = CameraModel(path, values, NONE).with_effect(effect)
    arguments = {
        name: torch.as_tensor(value, dtype=torch.float64) for name, value in parameters.items()
    }
    assert arguments.keys() <= model.means.keys()
    landed, failure = model.path.land(
        torch.from_numpy(pixels),
        {**model.means, **arguments},
        torch.from_numpy(POSE).expand(len(pixels), 6),
        MIDDLE,
    )
    assert not failure.any()
    return landed.numpy()


def test_board_shape_is_where_rays_meet_the_surface() -> None:
    """Oracle: bisection along each ray for the height above xx (1 - u^2) + xy u v + yy (1 - v^2)
    and numpy's Legendre series in u and v.
    """
    rng = np.random.default_rng(6)
    effect = proposed(BoardShape)
    sizes = {
        unknown.param.name.removeprefix("board_shape."): float(rng.normal(0, 2e-4))
        for unknown in effect.effect_parameters
    }
    assert len(sizes) == 12
    series = np.zeros((5, 5))
    for term, size in sizes.items():
        if len(term) > 2:
            series[term.count("x"), term.count("y")] = size
    pixels = projected(np.column_stack([BOARD.points(), np.zeros(BOARD.count)]), POSE)
    turn = Rotation.from_rotvec(POSE[:3]).as_matrix()
    start = -POSE[3:] @ turn

    def above(point: Array) -> float:
        u, v = np.clip(point[:2] / [0.08, 0.06], -1.25, 1.25)  # the search starts far outside
        dish = sizes["xx"] * (1 - u**2) + sizes["xy"] * u * v + sizes["yy"] * (1 - v**2)
        return float(point[2] - dish - np.polynomial.legendre.legval2d(u, v, series))

    expected = []
    for direction in pinhole(pixels) @ turn:
        distance = oracle.bisect(lambda t, d=direction: above(start + t * d), 0.0, 1.0)  # type: ignore[misc]
        expected.append((start + distance * direction)[:2])
    result = land(effect, pixels, {f"board_shape.{term}": size for term, size in sizes.items()})
    assert np.abs(result - expected).max() < 1e-13
    assert np.abs(result - BOARD.points()).max() > 1e-4


def test_board_shape_takes_the_degree_that_made_the_residual() -> None:
    """Random directions of the corners, exactly known, and a residual of some of the terms."""
    rng = np.random.default_rng(8)
    effect = proposed(BoardShape)
    assert isinstance(effect, BoardShape)
    columns = rng.normal(0, 100.0, (400, 12))
    for degree, count in ((2, 3), (3, 7), (4, 12)):
        residual = columns[:, :count] @ rng.normal(0, 0.2, count) + rng.standard_normal(400)
        assert effect.tune(columns.T @ columns, columns.T @ residual).degree == degree


def test_a_positive_bow_takes_the_middle_away_from_the_camera() -> None:
    """A board seen square on: what is farther away lands nearer to the optical axis."""
    path, values = pinhole_path(INTRINSICS)
    model = CameraModel(path, values, NONE).with_effect(proposed(BoardShape))
    corner = torch.tensor([[0.0, 0.0], [0.08, 0.06]], dtype=torch.float64)
    pose = torch.tensor([0, 0, 0, 0, 0, 0.5], dtype=torch.float64).expand(2, 6)
    bowed = {
        **model.means,
        "board_shape.xx": torch.tensor(1e-3, dtype=torch.float64),
        "board_shape.yy": torch.tensor(2e-3, dtype=torch.float64),
    }
    assert np.allclose(
        model.path.place(corner, bowed, pose, MIDDLE)[:, 2].numpy(),
        [0.503, 0.5],
        rtol=0,
        atol=1e-15,
    )


def test_glass_on_a_screen_bends_a_ray_by_snell_s_law() -> None:
    """Oracle: the ray in the glass, by the vector form of Snell's law at its front."""
    thickness = 3e-3
    effect = ScreenGlass()
    assert proposed_for(POINTS) == (effect,)
    assert proposed_for(BOARD) == ()
    pixels = projected(np.column_stack([BOARD.points(), np.zeros(BOARD.count)]), POSE)
    turn = Rotation.from_rotvec(POSE[:3]).as_matrix()
    start = -POSE[3:] @ turn
    expected = []
    for direction in pinhole(pixels) @ turn:
        front = start + direction * ((-thickness - start[2]) / direction[2])
        in_glass = direction / 1.5
        in_glass[2] = np.sqrt(1 - in_glass[0] ** 2 - in_glass[1] ** 2)
        expected.append((front + in_glass * (thickness / in_glass[2]))[:2])
    result = land(effect, pixels, {"screen_glass.thickness": thickness})
    assert np.abs(result - expected).max() < 1e-15
    assert np.abs(result - BOARD.points()).max() > 1e-3


def test_a_corner_behind_glass_is_seen_where_its_ray_lands() -> None:
    """The residual in the image is that on the board, by the pixels' own rays."""
    path, values = pinhole_path(INTRINSICS)
    model = CameraModel(path, values, NONE).with_effect(ScreenGlass())
    values = {**model.means, "screen_glass.thickness": torch.tensor(3e-3, dtype=torch.float64)}
    flat = projected(np.column_stack([BOARD.points(), np.zeros(BOARD.count)]), POSE)
    poses = torch.from_numpy(POSE).expand(1, 6)
    landed = land(ScreenGlass(), flat, {"screen_glass.thickness": 3e-3})
    views = (View("a", flat, np.ones(BOARD.count)),)
    observations = replace(Observations.of(views, BOARD), corners=torch.from_numpy(landed))
    residual = residuals(model.path, values, observations, poses)
    assert residual.image.abs().max() < 1e-6  # px
    assert residual.board.abs().max() < 1e-15


def test_board_flex_is_a_shape_that_one_view_has_for_itself() -> None:
    """Two views of one pose: each sees what a board of its own shape would show all views."""
    shape = BoardShape(*BOARD.half, degree=4)
    names = [param.name for param in shape.params]
    sizes = np.random.default_rng(1).normal(0, 3e-4, (2, len(names)))
    pixels = projected(np.column_stack([BOARD.points(), np.zeros(BOARD.count)]), POSE)
    path, values = pinhole_path(INTRINSICS)
    flexed = CameraModel(path, values, NONE).with_effect(proposed(BoardFlex)).path
    for own in sizes:
        placed = torch.from_numpy(np.concatenate([POSE, own])).expand(len(pixels), -1)
        landed, failure = flexed.land(torch.from_numpy(pixels), values, placed, MIDDLE)
        assert not failure.any()
        shared = dict(zip(names, own.tolist(), strict=True))
        assert np.abs(landed.numpy() - land(shape, pixels, shared)).max() < 1e-13


def test_board_scale_is_opencv_s_view_of_stretched_points() -> None:
    stretch = 4e-3
    points = BOARD.points() * [1 + stretch / 2, 1 - stretch / 2]
    pixels = projected(np.column_stack([points, np.zeros(BOARD.count)]), POSE)
    result = land(proposed(BoardScale), pixels, {"board_scale.x_over_y": stretch})
    assert np.abs(result - BOARD.points()).max() < 1e-13
    assert np.abs(land(proposed(BoardScale), pixels, {}) - BOARD.points()).max() > 1e-4


def test_a_sheared_print_is_opencv_s_view_of_sheared_points() -> None:
    stretch, shear = 4e-3, 6e-3
    points = BOARD.points() @ [[1 + stretch / 2, shear / 2], [shear / 2, 1 - stretch / 2]]
    pixels = projected(np.column_stack([points, np.zeros(BOARD.count)]), POSE)
    numbers: dict[str, float | Array] = {
        "board_scale.x_over_y": stretch,
        "board_scale.shear": shear,
    }
    result = land(BoardScale(sheared=True), pixels, numbers)
    assert np.abs(result - BOARD.points()).max() < 1e-13
    assert (
        np.abs(land(BoardScale(), pixels, {"board_scale.x_over_y": stretch}) - BOARD.points()).max()
        > 1e-4
    )


def test_an_uneven_print_is_opencv_s_view_of_points_moved_by_legendre_series() -> None:
    """Oracle: numpy's Legendre series move the points, OpenCV shows them."""
    effect = proposed(BoardScale)
    rng = np.random.default_rng(4)
    sizes = {
        unknown.param.name: float(rng.normal(0, unknown.sigma))
        for unknown in effect.effect_parameters
    }
    assert len(sizes) == 16
    series = np.zeros((2, 4, 4))
    for name, size in sizes.items():
        if name.count(".") == 2:
            _, axis, term = name.split(".")
            series["xy".index(axis), term.count("x"), term.count("y")] = size
    points = BOARD.points()
    u, v = (points / BOARD.half).T
    stretch, shear = sizes["board_scale.x_over_y"] / 2, sizes["board_scale.shear"] / 2
    moved = points @ [[1 + stretch, shear], [shear, 1 - stretch]]
    moved = moved + np.column_stack(
        [np.polynomial.legendre.legval2d(u, v, item) for item in series]
    )
    pixels = projected(np.column_stack([moved, np.zeros(BOARD.count)]), POSE)
    assert (
        np.abs(land(effect, pixels, dict(sizes)) - points).max() < 1e-12
    )  # two of Newton's steps back
    assert np.abs(land(effect, pixels, {**sizes, "board_scale.y.xxy": 0.0}) - points).max() > 1e-6


def test_board_scale_takes_the_form_that_made_the_residual() -> None:
    """Random directions of the corners, exactly known, and a residual of some of the terms."""
    rng = np.random.default_rng(9)
    effect = proposed(BoardScale)
    assert isinstance(effect, BoardScale)
    spread = np.array([unknown.sigma / unknown.param.scale for unknown in effect.effect_parameters])
    columns = rng.normal(0, 100.0, (400, len(spread)))
    for form in effect.alternatives():
        count = len(form.effect_parameters)
        residual = columns[:, :count] @ rng.normal(0, 0.3 * spread[:count]) + rng.standard_normal(
            400
        )
        assert effect.tune(columns.T @ columns, columns.T @ residual) == form


def test_free_field_over_the_board_is_a_cosine_transform_of_shifts() -> None:
    """Oracle: scipy's DCT gives the shifts of 9 x 9 points, OpenCV shows the shifted points."""
    effect = proposed(FreeField)
    assert isinstance(effect, FreeField)
    rng = np.random.default_rng(2)
    parameters: dict[str, float | Array] = {
        f"free_field.board.{axis}": rng.normal(0, 1e-5, 81) for axis in "xy"
    }
    x = (np.arange(9) + 0.5) / 9 * BOARD.columns * BOARD.square - BOARD.columns / 2 * BOARD.square
    y = (np.arange(9) + 0.5) / 9 * BOARD.rows * BOARD.square - BOARD.rows / 2 * BOARD.square
    points = np.stack(np.meshgrid(x, y, indexing="ij"), -1).reshape(-1, 2)
    shifts = np.column_stack([waves(np.asarray(n)).ravel() for n in parameters.values()])
    pixels = projected(np.column_stack([points + shifts, np.zeros(81)]), POSE)
    result = land(effect, pixels, parameters)
    assert np.abs(shifts).max() > 3e-5
    assert np.abs(result - points).max() < 1e-12  # two of Newton's steps back
