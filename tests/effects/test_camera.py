"""Effects on the camera, each against an oracle that was built without it."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from calib.corners.view import View
from calib.effects.detector_bias import DetectorBias
from calib.effects.effect import Effect
from calib.effects.focal import Focal
from calib.effects.lens import LensEffect
from calib.effects.lens_field import LensField
from calib.effects.principal_point import PrincipalPoint
from calib.effects.rolling_shutter import RollingShutter
from calib.effects.varying import (
    ALTERNATING,
    FROM_VIEW,
    WITH_TIME,
    FocalOfView,
    PrincipalPointOfView,
    Varying,
)
from calib.estimation.camera_model import CameraModel
from calib.estimation.observations import Observations
from calib.estimation.priors import NONE
from calib.optics.build import pinhole_path
from calib.optics.exposure import MIDDLE
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.parameter_names import CAMERA
from calib.session.schema import Number
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH
from tests.effects.forms import LENS
from tests.effects.rays import Array, camera_matrix, projected, waves

BOARD = Board(9, 7, 0.02)
SOLID = np.column_stack([BOARD.points(), np.zeros(BOARD.count)])
POSES = np.array(
    [
        [0.3, -0.4, 0.2, -0.05, 0.04, 0.5],
        [-0.5, 0.1, 0.0, 0.08, -0.03, 0.7],
        [0.1, 0.5, -0.3, 0.0, 0.02, 0.6],
    ]
)
PIXELS = np.random.default_rng(0).uniform([0, 0], [WIDTH - 1, HEIGHT - 1], (200, 2))


def directions(
    effect: Effect | None, intrinsics: Intrinsics, pixels: Array, **parameters: float
) -> Array:
    """(N, 2) x / z and y / z of the rays."""
    path, values = pinhole_path(intrinsics)
    base = CameraModel(path, values, NONE)
    model = base.with_effect(effect) if effect else base
    arguments = {
        name.replace("__", "."): torch.tensor(value, dtype=torch.float64)
        for name, value in parameters.items()
    }
    assert arguments.keys() <= model.means.keys()
    rays = model.path.trace(torch.from_numpy(pixels), {**model.means, **arguments}, MIDDLE)
    assert not rays.failure.any()
    return torch.stack(
        [rays.direction.x / rays.direction.z, rays.direction.y / rays.direction.z], -1
    ).numpy()


def landed(
    effect: Effect, corners: list[Array], poses: Array, times: list[float], **parameters: float
) -> Array:
    """(V, N, 2) m: where the pixels of each view land, less where its corners are."""
    path, values = pinhole_path(INTRINSICS)
    model = CameraModel(path, values, NONE).with_effect(effect)
    views = [
        View(f"{view}.png", pixels, np.ones(BOARD.count)) for view, pixels in enumerate(corners)
    ]
    observations = Observations.of(views, BOARD).add_times(times, HEIGHT)
    arguments = {
        name.replace("__", "."): torch.tensor(value, dtype=torch.float64)
        for name, value in parameters.items()
    }
    result, failure = model.path.land(
        observations.pixels,
        {**model.means, **arguments},
        torch.from_numpy(poses)[observations.view],
        observations.exposure,
    )
    assert not failure.any()
    return (result - observations.corners).reshape(len(corners), BOARD.count, 2).numpy()


def test_lens_is_opencv_s_distortion_from_the_distorted_to_the_undistorted_pixel() -> None:
    k1, k2, k3, p1, p2 = parameters = (-0.02, 0.013, -0.004, 1.5e-3, -8e-4)
    coefficients = dict(
        zip(("lens__k1", "lens__k2", "lens__k3", "lens__p1", "lens__p2"), parameters, strict=True)
    )
    solid = np.column_stack(
        [(PIXELS - camera_matrix()[:2, 2]) / camera_matrix()[0, 0], np.ones(len(PIXELS))]
    )
    expected = cv2.projectPoints(
        solid, np.zeros(3), np.zeros(3), np.eye(3), np.array([k1, k2, p1, p2, k3])
    )[0].reshape(-1, 2)
    assert (
        np.abs(directions(LensEffect(), INTRINSICS, PIXELS, **coefficients) - expected).max()
        < 1e-14
    )
    assert np.abs(expected - solid[:, :2]).max() > 1e-3


def test_lens_comes_before_the_lens_that_is_stated() -> None:
    k1 = 0.02
    matrix = np.array(
        [[LENS.fx.value, 0, LENS.cx.value], [0, LENS.fy.value, LENS.cy.value], [0, 0, 1]]
    )
    solid = np.column_stack(
        [(PIXELS - matrix[:2, 2]) / matrix.diagonal()[:2], np.ones(len(PIXELS))]
    )
    moved = cv2.projectPoints(solid, np.zeros(3), np.zeros(3), matrix, np.array([k1, 0, 0, 0.0]))[
        0
    ].reshape(-1, 2)
    stated = np.array([number.value for number in LENS.distortion])
    result = np.column_stack(
        [directions(LensEffect(), LENS, PIXELS, lens__k1=k1), np.ones(len(PIXELS))]
    )
    assert (
        np.abs(
            cv2.projectPoints(result, np.zeros(3), np.zeros(3), matrix, stated)[0].reshape(-1, 2)
            - moved
        ).max()
        < 1e-9
    )  # px
    assert np.abs(moved - PIXELS).max() > 1.0


def test_principal_point_is_a_camera_that_has_it_elsewhere() -> None:
    x, y = 3.5, -2.25
    expected = directions(None, INTRINSICS, PIXELS - [x, y])
    assert (
        np.abs(
            directions(
                PrincipalPoint(), INTRINSICS, PIXELS, principal_point__x=x, principal_point__y=y
            )
            - expected
        ).max()
        < 1e-15
    )


def test_focal_is_a_camera_with_longer_ones() -> None:
    change = 4e-3
    longer = Intrinsics(
        Number(LENS.fx.value * 1.004),
        Number(LENS.fy.value * 1.004),
        LENS.cx,
        LENS.cy,
        LENS.distortion,
    )
    assert (
        np.abs(
            directions(Focal(), LENS, PIXELS, focal__change=change)
            - directions(None, longer, PIXELS)
        ).max()
        < 1e-15
    )


@pytest.mark.parametrize(
    ("change", "turned"),
    [((10.0, 8.0), True), ((10.0, -8.0), False), ((13.0, 8.0), False), ((1.0, 0.8), False)],
)
def test_a_half_turn_mirrors_the_principal_point(change: tuple[float, float], turned: bool) -> None:
    """The middle of 640x480 px is at (319.5, 239.5), and the later pictures have their principal
    point at (314.5, 235.5): so earlier ones that are turned have it at (324.5, 243.5).
    """
    effect = Varying("principal_point", FROM_VIEW, CAMERA.centre, (1.0, 1.0, 0.0))
    places = dict(zip(CAMERA.centre, (314.5, 235.5), strict=True))
    changes = dict(zip((param.name for param in effect.params), change, strict=True))
    values = {name: torch.tensor(value) for name, value in (places | changes).items()}
    assert effect.is_half_turn(values, 640, 480) == turned
    drift = Varying("principal_point", WITH_TIME, CAMERA.centre, (1.0, 0.5, 0.0))
    assert not drift.is_half_turn(values, 640, 480)


@pytest.mark.parametrize(
    "effect",
    [
        Varying("focal", FROM_VIEW, ("focal",), (-1.0, -1.0, 0.0)),
        Varying("principal_point", WITH_TIME, ("camera.cx", "camera.cy"), (-1.0, 0.2, 0.8)),
        Varying("lens", ALTERNATING, ("focal", "camera.cx", "lens.k1"), (-1.0, 1.0, 0.0)),
    ],
    ids=lambda effect: effect.name,
)
def test_numbers_that_follow_a_pattern_are_a_camera_for_each_view(effect: Varying) -> None:
    """With the step of a focal length, with a principal point that follows time, and with two
    lenses. Their radial term leads from the distorted pixel to the undistorted one.
    """
    all_sizes = {"focal": 5e-3, "camera.cx": 3.0, "camera.cy": -2.0, "lens.k1": 0.02}
    sizes = {name: all_sizes[name] for name in effect.numbers}
    corners = []
    for pose, follows in zip(POSES, effect.pattern, strict=True):
        matrix = camera_matrix()
        matrix[[0, 1], [0, 1]] *= 1 + sizes.get("focal", 0.0) * follows
        matrix[0, 2] += sizes.get("camera.cx", 0.0) * follows
        matrix[1, 2] += sizes.get("camera.cy", 0.0) * follows
        undistorted = projected(SOLID, pose, matrix)
        radial = np.array([sizes.get("lens.k1", 0.0) * follows, 0, 0, 0])
        distorted = undistorted.copy()
        for _ in range(30):  # until a pixel comes out where it was
            centred = (distorted - matrix[:2, 2]) / matrix.diagonal()[:2]
            solid = np.column_stack([centred, np.ones(len(centred))])
            reached = cv2.projectPoints(solid, np.zeros(3), np.zeros(3), matrix, radial)[0]
            distorted -= reached.reshape(-1, 2) - undistorted
        corners.append(distorted)
    names = (u.param.name.replace(".", "__") for u in effect.effect_parameters)
    parameters = dict(zip(names, sizes.values(), strict=True))
    times = [0.0, 1.0, 2.0]
    assert np.abs(landed(effect, corners, POSES, times, **parameters)).max() < 1e-14
    assert np.abs(landed(effect, corners, POSES, times)).max() > 1e-5


@pytest.mark.parametrize("effect", [FocalOfView(), PrincipalPointOfView()], ids=lambda e: e.name)
def test_every_view_may_have_a_camera_of_its_own(effect: FocalOfView) -> None:
    own = np.array([[5e-3, -2.0], [-2e-3, 4.0], [1e-3, 1.0]])
    own = own[:, :1] if effect.name == "focal" else own
    corners = []
    for pose, numbers in zip(POSES, own, strict=True):
        matrix = camera_matrix()
        if effect.name == "focal":
            matrix[[0, 1], [0, 1]] *= 1 + numbers[0]
        else:
            matrix[:2, 2] += numbers
        corners.append(projected(SOLID, pose, matrix))
    poses = np.column_stack([POSES, own])
    times = [0.0, 1.0, 2.0]
    assert np.abs(landed(effect, corners, poses, times)).max() < 1e-14
    assert (
        np.abs(landed(effect, corners, poses * ([1] * 6 + [0] * own.shape[1]), times)).max() > 1e-5
    )


def test_rolling_shutter_sees_each_corner_where_it_is_when_its_row_is_read() -> None:
    """Each row has its own pose: from the middle one half of the motion back at the top edge, half
    of it on at the bottom edge.
    """
    motions = np.array(
        [
            [0.02, -0.01, 0.03, 0.004, -0.003, 0.005],
            [0, 0, -0.05, 0.01, 0, 0],
            [0.01, 0.02, 0, 0, 0.006, -0.004],
        ]
    )
    corners = []
    for pose, motion in zip(POSES, motions, strict=True):
        pixels = projected(SOLID, pose)
        for _ in range(30):  # a corner's row says when it was read, and that says where it was
            lines = (pixels[:, 1] + 0.5) / HEIGHT - 0.5
            pixels = np.concatenate(
                [_at(point, pose, motion * line) for point, line in zip(SOLID, lines, strict=True)]
            )
        corners.append(pixels)
    poses = np.column_stack([POSES, motions])
    assert np.abs(landed(RollingShutter(), corners, poses, [0.0, 1.0, 2.0])).max() < 1e-13
    assert (
        np.abs(
            landed(
                RollingShutter(), corners, np.column_stack([POSES, 0 * motions]), [0.0, 1.0, 2.0]
            )
        ).max()
        > 1e-4
    )


def _at(point: Array, pose: Array, moved: Array) -> Array:
    """(1, 2) px of a board's point after a rotation about the board's origin and a shift, both in
    the camera's axes.
    """
    rotvec, _, *_ = cv2.composeRT(pose[:3], np.zeros(3), moved[:3], np.zeros(3))
    return projected(point[None], np.concatenate([rotvec.ravel(), pose[3:] + moved[3:]]))


def test_a_detector_with_a_positive_bias_draws_corners_to_the_middle_of_a_pixel() -> None:
    """Oracle: find what would be detected, seen = true - bias sin(2 pi seen), by bisection, and
    undo it by the effect.
    """
    biases = np.array([0.05, 0.02])
    low, high = np.floor(PIXELS + 0.5) - 0.5, np.floor(PIXELS + 0.5) + 0.5  # the edges of its pixel
    for _ in range(60):
        middle = (low + high) / 2
        short = middle + biases * np.sin(2 * np.pi * middle) < PIXELS
        low, high = np.where(short, middle, low), np.where(short, high, middle)
    centre = np.floor(PIXELS + 0.5)
    assert (np.abs(low - centre) <= np.abs(PIXELS - centre)).all()
    assert np.abs(low - PIXELS).max() > 0.04
    tangents = directions(
        DetectorBias(), INTRINSICS, low, detector_bias__x=biases[0], detector_bias__y=biases[1]
    )
    assert np.abs(tangents - directions(None, INTRINSICS, PIXELS)).max() < 1e-14


def test_lens_field_is_a_cosine_transform_of_shifts() -> None:
    """Oracle: scipy's DCT at the middles of 9 x 9 fields of the picture."""
    path, values = pinhole_path(INTRINSICS)
    rng = np.random.default_rng(1)
    parameters = {f"lens_field.{axis}": rng.normal(0, 0.3, 81) for axis in "xy"}
    model = CameraModel(path, values, NONE).with_effect(
        LensField((-0.5, -0.5), (WIDTH - 0.5, HEIGHT - 0.5), 0.5, 2.0)
    )
    columns = (np.arange(9) + 0.5) / 9 * WIDTH - 0.5
    rows = (np.arange(9) + 0.5) / 9 * HEIGHT - 0.5
    pixels = np.stack(np.meshgrid(columns, rows, indexing="ij"), -1).reshape(-1, 2)
    shifts = np.column_stack([waves(parameters[f"lens_field.{axis}"]).ravel() for axis in "xy"])
    rays = model.path.trace(
        torch.from_numpy(pixels),
        {**model.means, **{name: torch.from_numpy(n) for name, n in parameters.items()}},
        MIDDLE,
    )
    result = torch.stack(
        [rays.direction.x / rays.direction.z, rays.direction.y / rays.direction.z], -1
    ).numpy()
    assert np.abs(result - directions(None, INTRINSICS, pixels + shifts)).max() < 1e-14
    assert np.abs(shifts).max() > 0.3


def test_lens_field_leaves_the_meaning_of_the_focal_lengths() -> None:
    """At its centre the shift is zero and has no slope along its own direction, by central
    differences, and elsewhere it differs from the waves by a line.
    """
    rng = np.random.default_rng(2)
    corners = (-0.5, -0.5), (WIDTH - 0.5, HEIGHT - 0.5)
    centre = torch.tensor([0.47 * WIDTH, 0.55 * HEIGHT], dtype=torch.float64)
    field = LensField(*corners, 0.5, 2.0, tuple(centre.tolist()))
    values = {name: torch.from_numpy(rng.normal(0, 0.3, 81)) for name in field.probes}

    def shift(field: LensField, x: Tensor, y: Tensor) -> Tensor:
        return torch.stack([value for value, *_ in field.shift(x, y, values)], -1)

    steps = 1e-3 * torch.tensor([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]], dtype=torch.float64)
    at_centre = shift(field, *(centre + steps).T)
    assert at_centre[0].abs().max() < 1e-12
    slopes = (at_centre[1::2] - at_centre[2::2]) / 2e-3
    assert slopes.diagonal().abs().max() < 1e-9
    assert slopes.abs().max() > 1e-4
    x, y = torch.from_numpy(PIXELS).T
    line = shift(replace(field, centre=()), x, y) - shift(field, x, y)
    for direction, coordinate in enumerate((x, y)):
        basis = torch.stack([torch.ones_like(coordinate), coordinate], -1)
        rest = line[:, direction] - basis @ torch.linalg.lstsq(basis, line[:, direction]).solution
        assert rest.abs().max() < 1e-10
    weights = field.weights(x, y)
    sums = torch.stack([weights[name] @ values[name] for name in values], -1)
    assert (sums - shift(field, x, y)).abs().max() < 1e-12
