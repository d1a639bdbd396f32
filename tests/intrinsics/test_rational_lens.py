"""A rational lens: its poles, and the prior that keeps them out of the picture."""

import cv2
import numpy as np
import pytest
import torch

from calib.corners.view import View
from calib.intrinsics import opencv_lens
from calib.intrinsics.opencv_by_rays import prior_means
from calib.intrinsics.opencv_fit import has_pole
from calib.optics.build import pinhole_path
from calib.session.board import Board
from calib.session.camera import Intrinsics
from calib.session.schema import Number

BOARD = Board(8, 6, 0.0254)
FOCAL = 660.0
MIDDLE = np.array([320.0, 240.0])


@pytest.mark.parametrize(
    ("radial", "corner", "expected"),
    [
        ((18.22, -62.28, -483.0, 17.86, -78.89, -371.6), 0.6, True),  # OpenCV's, of a measured set
        ((8.81, 56.07, -163.0, 8.34, 46.15, -147.51), 0.6, False),  # ours, of the same
        ((0.6, 1.0, -8.0), 0.6, False),  # no denominator
        ((0.0, 0.0, 0.0, -2.0, 0.0, 0.0), 0.6, False),  # a pincushion, whose pole is outside
        ((-1.0, 0.0, 0.0, -1.0, 0.0, 0.0), 0.9, False),  # no lens at all, whose pole is outside
        ((-1.0, 0.0, 0.0, -1.0, 0.0, 0.0), 1.1, True),
    ],
)
def test_a_pole_inside_the_picture_is_noticed(
    radial: tuple[float, ...], corner: float, expected: bool
) -> None:
    side = corner / 2**0.5
    camera = np.array([[1.0, 0, side], [0, 1, side], [0, 0, 1]])
    coefficients = np.array([*radial[:2], 0.0, 0.0, *radial[2:]])
    assert has_pole(camera, coefficients) is expected


def test_the_means_of_the_priors_distort_nothing() -> None:
    numbers = Number(500.0), Number(480.0), Number(300.0), Number(250.0)
    _, values = pinhole_path(Intrinsics(*numbers, tuple(map(Number, (0.3, 2, 0, 0, 4, 1, 2, 3)))))
    means = prior_means(values)
    names = [f"camera.{name}" for name in ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")]
    camera = np.array([[500.0, 0, 300], [0, 480, 250], [0, 0, 1]])
    points = np.random.default_rng(0).uniform((-1, -1, 1), (1, 1, 3), (50, 3))
    lens = torch.stack([means[name] for name in names]).numpy()
    pixels, *_ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera, lens)
    straight, *_ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera, np.zeros(8))
    np.testing.assert_allclose(pixels, straight, atol=1e-9)
    assert min(lens[4:]) > 0


@pytest.mark.parametrize("seed", [3, 9])
def test_a_lens_with_a_pole_inside_the_picture_is_fitted_again(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    views = views_in_water(seed)
    five = opencv_lens.fit_opencv(views, BOARD, (640, 480), 5)
    eight = opencv_lens.fit_opencv(views, BOARD, (640, 480), 8, earlier={5: five})
    assert not eight.has_pole
    assert eight.rms < 1.002 * five.rms, "8 coefficients fit no worse than 5"
    monkeypatch.setattr(opencv_lens, "_fit_through_rays", lambda *_: None)
    opencv_s = opencv_lens.refine_opencv(views, BOARD, (640, 480), 8, five)
    assert opencv_s is None, "OpenCV's own fit has a pole"


@pytest.mark.slow
def test_opencv_s_own_fit_often_has_a_pole(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opencv_lens, "_fit_through_rays", lambda *_: None)
    sessions = [views_in_water(seed) for seed in range(12)]
    fits = [opencv_lens.fit_opencv(views, BOARD, (640, 480), 8) for views in sessions]
    poles = fits.count(None)  # type: ignore[arg-type]
    print(f"a pole in {poles} of {len(fits)}")
    assert poles >= 5


def views_in_water(seed: int) -> list[View]:
    """Return 20 views of a camera right behind a window in water, which leave the corners of the
    picture empty.
    """
    rng = np.random.default_rng(seed)
    points = BOARD.points_in_space() - BOARD.points_in_space().mean(0)
    views: list[View] = []
    while len(views) < 20:
        turn = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))[0]
        place = rng.uniform((-0.12, -0.08, 0.35), (0.12, 0.08, 0.7))
        x, y, z = (points @ turn.T + place).T
        tangent = np.hypot(x, y) / z
        in_air = np.tan(np.arcsin(1.333 * np.sin(np.arctan(tangent)))) / 1.333
        pixels = MIDDLE + FOCAL * (in_air / tangent)[:, None] * np.column_stack([x / z, y / z])
        off = pixels - MIDDLE
        if np.hypot(*off.T).max() < 300 and (abs(off) < MIDDLE - 10).all():
            noisy = pixels + rng.normal(0, 0.05, pixels.shape)
            views.append(View(f"{len(views):04}.png", noisy, np.ones(len(points))))
    return views
