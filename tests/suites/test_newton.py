"""Newton's camera of rays, on the CPU: its depths of a wall and a ball by the exported rays,
against the same depths by geometry, and those of a central camera.
"""

from pathlib import Path

import numpy as np
import pytest

from calib.cli import main
from tests.export import truth
from tests.suites.fetch import NEWTON

WALL_Z = -0.5
"""m, in the camera frame of OpenGL, which looks along -z."""
BALL = np.array([0.03, 0.02, -0.35])
"""m"""
RADIUS = 0.05
"""m"""


def depths_by_newton(rays: np.ndarray) -> np.ndarray:
    """Return the (H, W) m from each ray's origin to what it hits.

    Args:
        rays: (H, W, 2, 3) origins in m and unit directions.
    """
    newton = pytest.importorskip("newton", reason=NEWTON.skipped)
    warp = pytest.importorskip("warp", reason=NEWTON.skipped)
    with warp.ScopedDevice("cpu"):
        turn = warp.quat_identity()
        builder = newton.ModelBuilder()
        wall = warp.transform((0.0, 0.0, WALL_Z - 0.1), turn)
        builder.add_shape_box(-1, xform=wall, hx=5.0, hy=5.0, hz=0.1)
        builder.add_shape_sphere(-1, xform=warp.transform(tuple(BALL), turn), radius=RADIUS)
        model = builder.finalize()
        camera = newton.sensors.SensorCamera(model)
        depths = warp.zeros((1, *rays.shape[:2]), dtype=warp.float32)
        camera.update(
            model.state(),
            warp.array([warp.transform((0.0, 0.0, 0.0), turn)], dtype=warp.transformf),
            warp.array(rays[:, :, None], dtype=warp.vec3f),
            depth_image=depths,
        )
        return np.asarray(depths.numpy()[0])


def depths_by_geometry(rays: np.ndarray) -> np.ndarray:
    """Return the same depths from the equations of a plane and a sphere."""
    origins, directions = np.moveaxis(rays.astype(float), 2, 0)
    wall = (WALL_Z - origins[..., 2]) / directions[..., 2]
    from_ball = origins - BALL
    projection = (from_ball * directions).sum(-1)
    square = projection**2 - (from_ball**2).sum(-1) + RADIUS**2
    ball = -projection - np.sqrt(np.maximum(square, 0))
    return np.asarray(np.where(square > 0, ball, wall))


@pytest.mark.slow
def test_depths_of_the_exported_rays(tmp_path: Path) -> None:
    pytest.importorskip("newton", reason=NEWTON.skipped)
    truth.small().save(tmp_path)
    command = ["export", str(tmp_path), "--format", "ray-image", "--axes", "opengl"]
    assert main([*command, "-o", str(tmp_path / "out")]) == 0
    rays = np.load(tmp_path / "out" / "ray_image_opengl.npy")
    rays = rays[20:-20, 20:-20]  # all of these leave the cone
    assert np.isfinite(rays).all()
    expected = depths_by_geometry(rays)
    differences = np.abs(depths_by_newton(rays) - expected)
    assert np.quantile(differences, 0.999) < 5e-6
    assert differences.max() < 1e-4, "at the rim of the ball, by float32"
    central = rays.copy()
    central[..., 0, :] = rays[..., 0, :].mean((0, 1))
    assert np.abs(depths_by_newton(central) - expected).mean() > 5e-4
