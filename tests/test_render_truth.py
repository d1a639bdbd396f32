"""The sessions that hide an effect, against light traced apart: bisection and Snell's law in double
precision, no mesh, nothing of `fixtures` and nothing of `calib.optics`.
"""

from collections.abc import Callable

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fixtures.rays import FIXTURES

Array = NDArray[np.float64]

NEUTRAL = {
    "board_bow": (0, 0),
    "print_stretch": 0,
    "print_wave": (0, 1, 0),
    "bump": (),
    "cover_tilt": (0, 0),
    "line_s": 0,
}
HIDDEN: dict[str, dict[str, object]] = {
    "bow": {"board_bow": (1.0e-3, -0.6e-3)},
    "stretch": {"print_stretch": 4e-3},
    "shutter": {"line_s": 37.8e-6},
    "bump": {"bump": (4e-6, 6e-4, 1e-3, np.deg2rad(3.0))},
    "two": {"board_bow": (-0.7e-3, 0.9e-3), "print_stretch": 5e-3},
    "wave": {"print_wave": (0.25e-3, 0.070, 0.7)},
    "tilted": {"cover_tilt": (0.016, 0.012)},
}
FOLDERS = [name + inner for name in HIDDEN for inner in ("", "/holdout")]
INNER_RADIUS, RADIUS_SLOPE, AXIS, THICKNESS, INDEX = (
    0.04195,
    -0.105,
    np.array([0.0, 0.0, -0.030]),
    0.003,
    1.5,
)  # SI, as stated

each_folder = pytest.mark.parametrize("name", FOLDERS)


def loaded(name: str) -> dict[str, Array]:
    with np.load(FIXTURES / name / "truth.npz") as file:
        return dict(file)


def printed(truth: dict[str, Array]) -> Array:
    """(81, 3) m: where the corners lie on the sheet."""
    x, y, _ = truth["board"].T
    size, length, phase = truth["print_wave"]
    x = x + truth["print_stretch"] * x + size * np.sin(2 * np.pi / length * x + phase)
    (first, second), half = truth["board_bow"], 0.08
    return np.column_stack(
        [x, y, first + second - first * (x / half) ** 2 - second * (y / half) ** 2]
    )


def corner_points(truth: dict[str, Array], view: int) -> Array:
    """(81, 3) m in the camera frame, each at the time of its row: the middle row's is zero, and row
    615 is the last.
    """
    time = (truth["corners"][view, :, 1] - 615 / 2)[:, None] * truth["line_s"]
    arm = printed(truth) @ truth["rotations"][view].T
    turned: Array = Rotation.from_rotvec(time * truth["spins"][view]).apply(arm)
    points: Array = turned + truth["translations"][view] + time * truth["velocities"][view]
    return points


def leave(truth: dict[str, Array], pixels: Array) -> tuple[Array, Array]:
    """(N, 2) px -> (N, 3) m where light leaves the glass, and (N, 3) its directions."""
    focal, centre = truth["intrinsics"][:2], truth["intrinsics"][2:]
    cover_from_camera = Rotation.from_rotvec(
        [truth["cover_tilt"][0], 0, truth["cover_tilt"][1]]
    ).inv()
    d = np.column_stack([(pixels - centre) / focal, np.ones(len(pixels))])
    d = cover_from_camera.apply(d / np.linalg.norm(d, axis=1, keepdims=True))
    o = np.tile(cover_from_camera.apply(-AXIS), (len(pixels), 1))

    def inner(p: Array) -> Array:
        distance: Array = np.hypot(p[:, 0], p[:, 2]) - INNER_RADIUS - RADIUS_SLOPE * p[:, 1]
        return distance

    def outer(p: Array) -> Array:
        y, theta = p[:, 1], np.arctan2(p[:, 0], p[:, 2])
        n = len(truth["amplitudes"])
        wide = np.array([0.020, np.deg2rad(30)]) / (n - 1)
        offset = (np.column_stack([y, theta])[:, None] - truth["centres"]) / wide  # (N, n * n, 2)
        relief = np.exp(-(offset**2).sum(-1) / 2) @ truth["amplitudes"].ravel()
        if len(truth["bump"]):
            height, sigma, at_y, at_theta = truth["bump"]
            arc = (theta - at_theta) * (INNER_RADIUS + THICKNESS)
            relief += height * np.exp(-((y - at_y) ** 2 + arc**2) / (2 * sigma**2))
        distance: Array = inner(p) - THICKNESS - relief
        return distance

    for surface, ratio in ((inner, 1 / INDEX), (outer, INDEX)):
        o = o + intersect(surface, o, d)[:, None] * d
        normal = np.column_stack(
            [surface(o + step) - surface(o - step) for step in 1e-6 * np.eye(3)]
        )
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        refracted = ratio * (
            d - (d * normal).sum(1, keepdims=True) * normal
        )  # the part in the surface keeps n sin
        d = refracted + np.sqrt(1 - (refracted**2).sum(1, keepdims=True)) * normal
    return cover_from_camera.inv().apply(o) + AXIS, cover_from_camera.inv().apply(d)


def intersect(surface: Callable[[Array], Array], o: Array, d: Array) -> Array:
    """(N,) m along each ray, by bisection: negative inside, positive outside."""
    low, high = np.zeros(len(o)), np.full(len(o), 0.06)
    for _ in range(52):
        middle = (low + high) / 2
        is_beyond = surface(o + middle[:, None] * d) > 0
        low, high = np.where(is_beyond, low, middle), np.where(is_beyond, middle, high)
    return low


def off(truth: dict[str, Array]) -> Array:
    """(V * 81,) px between each true corner and where the light of its pixel goes."""
    misses = []
    for view, pixels in enumerate(truth["corners"]):
        o, d = leave(truth, pixels)
        points = corner_points(truth, view)
        miss = o + d * ((points - o)[:, 2:] / d[:, 2:]) - points
        misses.append(np.linalg.norm(miss[:, :2] / points[:, 2:] * truth["intrinsics"][0], axis=1))
    return np.concatenate(misses)


@each_folder
def test_light_of_every_true_corner_s_pixel_meets_that_corner(name: str) -> None:
    """Measured: 0.0003 px at worst, 0.003 px where the facets round the narrow bump off."""
    error = off(loaded(name))
    print(f"{name}: {np.sqrt((error**2).mean()):.5f} px RMS, {error.max():.5f} at worst")
    assert error.max() < (5e-3 if name.startswith("bump") else 1e-3)


@pytest.mark.parametrize(
    ("name", "key"), [(name, key) for name, keys in HIDDEN.items() for key in keys]
)
def test_without_a_hidden_effect_corners_would_lie_elsewhere(name: str, key: str) -> None:
    error = off({**loaded(name), key: np.asarray(NEUTRAL[key], dtype=float)})
    print(
        f"{name} without {key}: {np.sqrt((error**2).mean()):.2f} px RMS, {error.max():.2f} at"
        f" worst, {(error > 0.2).sum()} above 0.2 px"
    )
    assert error.max() > 0.25


@each_folder
def test_every_hidden_effect_and_no_other_is_in_the_truth(name: str) -> None:
    truth = loaded(name)
    for key, value in {**NEUTRAL, **HIDDEN[name.split("/")[0]]}.items():
        assert np.array_equal(truth[key], np.asarray(value)), key
    assert (truth["velocities"].any() and truth["spins"].any()) == name.startswith("shutter")


@pytest.mark.parametrize("name", HIDDEN)
def test_no_session_declares_its_effect(name: str) -> None:
    stated = [
        yaml.safe_load((FIXTURES / folder / "session.yaml").read_text())
        for folder in (name, f"{name}/holdout", "clean")
    ]
    assert stated[0] == stated[1]
    assert {key: stated[0][key] for key in ("board", "cover")} == {
        key: stated[2][key] for key in ("board", "cover")
    }
