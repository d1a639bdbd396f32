"""The part of the glass that the camera sees, as a relief of the cover's outer surface."""

from __future__ import annotations

import numpy as np
import torch

from calib.estimation.camera_model import CameraModel
from calib.estimation.stated_priors import priors_of
from calib.estimation.surface_prior import expected_amplitudes
from calib.fit_record.request import Settings
from calib.fitting.setup import Setup
from calib.optics.build import covered_path, footprint, relief_over, with_relief
from calib.optics.params import Values
from calib.optics.path import Path
from calib.optics.relief import AMPLITUDES, Relief
from calib.optics.relief_view import described_at

MAX_SHIFT = 0.08
"""The largest change of the seen glass, as a fraction of it, for which a relief is kept: its prior
is that of the glass within the picture.
"""


def seen_relief(setup: Setup, settings: Settings, path: Path, values: Values) -> Relief:
    """Return the relief of the glass that the camera sees at these values, or of a known glass."""
    assert settings.grid, "the caller chooses the grid"
    grid = settings.grid[::-1]
    if glass := setup.cover.glass:
        return Relief.around(glass.low, glass.high, grid)
    region = footprint(path, values, setup.camera.width, setup.camera.height)
    return relief_over(path, values, region, grid)


def covers_seen_glass(
    relief: Relief, setup: Setup, settings: Settings, path: Path, values: Values
) -> bool:
    """Return True if the region of a relief is about the one that the camera sees at these
    values.
    """
    if not (relief.anchor and relief.size):
        return True
    seen = described_at(seen_relief(setup, settings, path, values), relief.anchor, relief.size)
    (low, high), (seen_low, seen_high) = np.array(relief.region), np.array(seen.region)
    off = np.maximum(np.abs(low - seen_low), np.abs(high - seen_high))
    return bool((off < MAX_SHIFT * (seen_high - seen_low)).all())


def with_uneven_glass(
    even: CameraModel, relief: Relief, setup: Setup, settings: Settings
) -> CameraModel:
    """Return the model with a relief, whose mean is that of a known glass."""
    path, values = covered_path(setup.intrinsics, setup.cover)
    path = with_relief(path, relief, exact_hit=settings.exact_hit)
    flat = {AMPLITUDES: torch.from_numpy(expected_amplitudes(relief, setup.cover.glass))}
    priors = priors_of(setup.intrinsics, setup.cover, path)
    return CameraModel(path, {**values, **flat}, priors).with_effects(even.effects)
