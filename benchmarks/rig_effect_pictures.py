"""The pictures of docs/effects of the causes by which cameras of a rig disagree: what each leaves
of the corners when one pose of the board is fitted to both cameras, at the true numbers.

`python -m benchmarks.rig_effect_pictures` draws them and prints the sizes.
"""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO

import numpy as np
import torch
from matplotlib import pyplot as plt
from numpy.typing import NDArray
from PIL import Image

from benchmarks.effect_pictures import (
    COLOURS,
    FOLDER,
    SHOWN,
    _arrows,
    _magnified,
)
from benchmarks.rig_diagnosis import WINDOW, flex, late, slip
from calib.estimation.observations import Observations
from calib.estimation.residuals import residuals
from calib.rig.later_views import PlacedViews, fit_placements
from calib.session.board import Board
from fixtures.rigs import SimulatedRig, simulate_rig
from fixtures.synthetic import HEIGHT, WIDTH

Array = NDArray[np.float64]
MADE: dict[str, Callable[[np.random.Generator, SimulatedRig], SimulatedRig]] = {
    "sync_offset": late,
    "rig_flex": flex,
    "rig_slip": slip,
}


def main() -> None:
    torch.set_num_threads(1)
    for name, make in MADE.items():
        rng = np.random.default_rng(2)
        bare = simulate_rig(
            2,
            WINDOW,
            placements=1,
            amplitude=0.0,
            noise_px=0.0,
            exact=True,
            board=Board(6, 5, 0.03),
        )
        rms = draw(name, bare, make(rng, bare))
        size = (FOLDER / f"{name}.png").stat().st_size
        print(f"{name:18} leaves {rms:7.4f} px RMS  picture {size / 1e3:.0f} kB", flush=True)


def draw(name: str, bare: SimulatedRig, simulated: SimulatedRig) -> float:
    """Draw what is left at the mountings without the effect, and return its size in px."""
    placed = []
    for camera_name, camera in bare.cameras.items():
        observations = Observations.of(simulated.views[camera_name], simulated.board)
        places = torch.arange(len(observations.names))
        placed.append(
            PlacedViews(camera.path, camera.values, observations, camera.mounting, places)
        )
    placements = fit_placements(placed, simulated.placements)
    errors = [
        -residuals(views.path, views.values, views.observations, views.poses(placements)).image
        for views in placed
    ]
    rms = float((torch.cat(errors) ** 2).sum(-1).mean().sqrt())
    figure, axes = plt.subplots(1, 2, figsize=(8.4, 3.4), layout="constrained")
    shown = np.linspace(0, len(places) - 1, SHOWN).astype(int)
    all_errors = torch.cat(errors).numpy()
    scale = _magnified(all_errors, 180.0)
    for panel, camera_name, views, residual in zip(axes, bare.cameras, placed, errors, strict=True):
        view = views.observations.view.numpy()
        for colour, number in zip(COLOURS, shown, strict=True):
            chosen = view == number
            pixels = views.observations.pixels.numpy()[chosen]
            _arrows(panel, pixels, residual.numpy()[chosen] * scale, colour)
        panel.set(aspect="equal", xlim=(0, WIDTH), ylim=(HEIGHT, 0), xticks=[], yticks=[])
        panel.set_title(
            f"{camera_name}: {SHOWN} of {len(places)} placements, as seen less the model,"
            f" x{scale:,.0f}",
            fontsize=8.5,
        )
    drawn = BytesIO()
    figure.savefig(drawn, dpi=84)
    plt.close(figure)
    Image.open(drawn).convert("RGB").quantize(64).save(FOLDER / f"{name}.png", optimize=True)
    return rms


if __name__ == "__main__":
    main()
