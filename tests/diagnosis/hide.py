"""Synthetic sessions with an effect that nobody declares."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import torch

from calib.calibration import Calibration
from calib.corners.view import View
from calib.effects.effect import Effect
from calib.fit_record.request import Settings
from calib.optics.build import pinhole_path
from calib.optics.exposure import MIDDLE
from calib.optics.projection import project
from fixtures.calibrated import GLASS, calibrate
from fixtures.known import lens_alone
from fixtures.synthetic import HEIGHT, INTRINSICS, WIDTH, Scene, scene


def hidden(
    effect: Effect | None,
    parameters: Mapping[str, float],
    seed: int = 1,
    views: int = 15,
    spoiled: int = 0,
) -> Scene:
    """Views with 0.1 px noise through uneven glass, and one effect; some views have corners that
    are off by 0.4 px.
    """
    made = scene(seed, views, (4, 4), 1e-5, 0.0, cover=GLASS)
    path = effect.apply(made.path) if effect else made.path
    values = {
        **made.values,
        **{name: torch.tensor(value, dtype=torch.float64) for name, value in parameters.items()},
    }
    rng = np.random.default_rng(seed)
    visible = []
    for index, (view, pose) in enumerate(zip(made.views, made.poses, strict=True)):
        pixels = project(
            path,
            values,
            path.place(torch.from_numpy(made.board.points()), values, pose, MIDDLE),
            MIDDLE,
        ).numpy()
        sigma = 0.4 if index < spoiled else 0.1
        visible.append(View(view.name, pixels + rng.normal(0, sigma, pixels.shape), view.weight))
    return replace(made, views=tuple(visible))


def fitted(made: Scene) -> Calibration:
    """Return the calibration as `calib fit` writes it."""
    return calibrate(made, Settings(grid=(8, 8)))


def without_cover(
    effect: Effect, parameters: Mapping[str, float], noise: float, seed: int = 3
) -> Calibration:
    """20 views without a cover, as a fit without the effect leaves them: at the true poses."""
    made = scene(seed, views=20)
    path, values = pinhole_path(INTRINSICS)
    bent = effect.apply(path)
    values = {
        **values,
        **{name: torch.tensor(value, dtype=torch.float64) for name, value in parameters.items()},
    }
    rng = np.random.default_rng(seed)
    points = torch.from_numpy(made.board.points())
    views = []
    for index, pose in enumerate(made.poses):
        pixels = project(bent, values, bent.place(points, values, pose, MIDDLE), MIDDLE).numpy()
        views.append(
            View(
                f"{index:04d}.png",
                pixels + rng.normal(0, noise, pixels.shape),
                np.ones(len(points)),
            )
        )
    intrinsics = (float(values[f"camera.{name}"]) for name in ("fx", "fy", "cx", "cy"))
    return replace(
        lens_alone(made, WIDTH, HEIGHT, *intrinsics), views=tuple(views), poses=made.poses.numpy()
    )
