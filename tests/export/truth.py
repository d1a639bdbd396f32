"""Calibrations of known optics, what they see, and what exported files say about themselves."""

import re
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.calibration_content import Stage
from calib.optics.relief import Relief
from calib.session.camera import Camera, Intrinsics
from calib.session.cover import Cover
from calib.session.schema import Number
from fixtures.synthetic import HEIGHT, INTRINSICS, PATCH, WIDTH, scene

Array = NDArray[np.float64]

LENS = Intrinsics(
    INTRINSICS.fx,
    INTRINSICS.fy,
    INTRINSICS.cx,
    INTRINSICS.cy,
    tuple(map(Number, (-0.05, 0.02, 1e-3, -5e-4, 0.004))),
)
STATED = re.compile(
    r"Misfit over the image: ([0-9.]+) px RMS, ([0-9.]+) px at worst, at ([0-9.]+) m\."
)
CENTRE = re.compile(r"origin is at \((\S+), (\S+), (\S+)\) mm")


def covered() -> Calibration:
    """The paper's camera in its cone, with bumps."""
    made = scene(11, views=3, amplitude=3e-6)
    return _calibration(
        made.cover, INTRINSICS, Relief(*PATCH, (4, 4)), made.values["relief.amplitudes"].numpy()
    )


def small() -> Calibration:
    """The same with a quarter of the pixels in each direction, binned four by four."""
    calibration = covered()
    k = INTRINSICS
    cx = Number((k.cx.value - 1.5) / 4)
    cy = Number((k.cy.value - 1.5) / 4)
    binned = Intrinsics(Number(k.fx.value / 4), Number(k.fy.value / 4), cx, cy)
    views = tuple(replace(view, corners=(view.corners - 1.5) / 4) for view in calibration.views)
    return replace(
        calibration, camera=Camera(WIDTH // 4, HEIGHT // 4, intrinsics=binned), views=views
    )


def bare() -> Calibration:
    """The same camera with a lens, without a cover: central as it is."""
    return _calibration(Cover("none", {}), LENS, None, np.zeros((0, 0)))


def port(shape: str) -> Calibration:
    """A camera with a lens under water, behind a tilted window (flat) or in a dome whose centre is
    beside the pinhole.
    """
    ours = {
        "flat": {"distance": 0.021, "tilt.x": 0.12, "tilt.y": -0.07},
        "dome": {"inner_radius": 0.05, "centre.x": 0.004, "centre.y": -0.003, "centre.z": -0.012},
    }[shape]
    numbers = ours | {"thickness": 0.006, "refractive_index": 1.49, "outside_index": 1.34}
    cover = Cover(shape, {name: Number(value) for name, value in numbers.items()})
    return _calibration(cover, LENS, None, np.zeros((0, 0)))


def _calibration(
    cover: Cover, intrinsics: Intrinsics, relief: Relief | None, amplitudes: Array
) -> Calibration:
    made = scene(11, views=3)
    camera = Camera(WIDTH, HEIGHT, "Test camera (3280x2464)", intrinsics)
    stages, none = (Stage("pinhole", 1.0, 0.1),), np.zeros((0, 0))
    poses = made.poses.numpy()
    return Calibration(
        made.board,
        camera,
        cover,
        relief,
        amplitudes,
        True,
        made.views,
        poses,
        none,
        (),
        stages,
        0.1,
        "as made",
    )


def seen(calibration: Calibration, depth: float, count: int = 4000) -> tuple[Array, Array]:
    """(N, 2) px anywhere on the image, and the (N, 3) m points of the camera frame that they see at
    depth m.
    """
    pixels = np.random.default_rng(5).uniform(0, [WIDTH - 1, HEIGHT - 1], (count, 2))
    origins, directions = calibration.rays(pixels)
    saved = np.isfinite(origins).all(-1)
    distance = (depth - origins[saved, 2]) / directions[saved, 2]
    return pixels[saved], origins[saved] + distance[:, None] * directions[saved]


def check_misfit(error: Array, rms: float, worst: float, exact: float = 1e-3) -> None:
    """(N, 2) px that a consumer is off must be what the file says, but for other pixels being
    looked at.
    """
    length = np.linalg.norm(error, axis=-1)
    result = float(np.sqrt((length**2).mean()))
    assert abs(result - rms) < 0.1 * rms + exact, f"{result:.4f} px where {rms:.4f} px are stated"
    assert length.max() < 1.1 * worst + exact, (
        f"up to {length.max():.4f} px where {worst:.4f} px are stated"
    )


def statements(text: str) -> list[tuple[float, float, float]]:
    """The (depth m, rms px, worst px) that a file's comments state."""
    results = [
        (float(depth), float(rms), float(worst)) for rms, worst, depth in STATED.findall(text)
    ]
    assert len(results) == 3
    return results


def centre(text: str) -> Array:
    """(3,) m: where the file's comments say that its camera stands."""
    result = CENTRE.search(text)
    assert result
    return np.array([float(entry) / 1000 for entry in result.groups()])


def distorted(tangents: Array, coefficients: list[float]) -> Array:
    """(N, 2) x / z and y / z through Brown's or the rational lens, written out from OpenCV's
    documentation.
    """
    k1, k2, p1, p2, k3, k4, k5, k6 = (*coefficients, *[0.0] * (8 - len(coefficients)))
    x, y = tangents.T
    r2 = x**2 + y**2
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    return np.column_stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2),
            y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y,
        ]
    )


def fisheye(tangents: Array, coefficients: list[float]) -> Array:
    """(N, 2) x / z and y / z through the equidistant lens of Kannala and Brandt."""
    r = np.linalg.norm(tangents, axis=-1)
    angle = np.arctan(r)
    bent = angle * (1 + sum(k * angle ** (2 * i) for i, k in enumerate(coefficients, start=1)))
    return np.asarray(tangents * (bent / r)[:, None])
