"""The description of an accepted effect: declared numbers with their increments, and the
parameters of the effect itself.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.diagnosis.finding import ParameterEstimate
from calib.fitting.declared import comparisons, effect_comparisons
from calib.optics.board_target import FLEX, block_columns


def describe_estimates(
    effect: str, calibration: Calibration, parameters: Mapping[str, ParameterEstimate]
) -> list[str]:
    """Return a text for each number; for parameters of single views, their root mean square.

    Args:
        effect: the name of the effect.
        calibration: the calibration with the effect.
        parameters: the estimates of the diagnosis; for a field, its root mean square.
    """
    texts = [number.summed for number in comparisons(calibration) if number.effect == effect]
    for number in effect_comparisons(calibration):
        if number.effect == effect:
            texts.append(f"{number.name} {number.estimated}")
    for name, estimate in parameters.items():
        if name.endswith(".rms"):
            texts.append(f"{name} {estimate}")
    for added in calibration.effects:
        if added.effect.name == effect and added.effect.per_view:
            texts += _describe_view_parameters(added.effect.per_view, calibration)
    return texts


def _describe_view_parameters(block: str, calibration: Calibration) -> list[str]:
    """Return the root mean square of the views' own parameters."""
    path, _ = calibration.model()
    values = calibration.poses[:, block_columns(path.view_blocks)[block]]
    if block == FLEX:
        return [
            f"boards bend by {1e3 * _rms(values):.2g} mm (root mean square over views and terms)"
        ]
    shutter = calibration.camera.shutter
    seconds = 1.0
    unit = "readout"
    if shutter and shutter.readout:
        seconds = shutter.readout
        unit = "second"
    rotation = np.degrees(_rms(values[:, :3])) / seconds
    translation = 1e3 * _rms(values[:, 3:]) / seconds
    return [
        f"boards turn by {rotation:.2g} degrees and move by {translation:.2g} mm in a {unit} (root"
        " mean square over views)"
    ]


def _rms(vectors: NDArray[np.float64]) -> float:
    """Return the root mean square length of (V, k) vectors."""
    return float(np.sqrt((vectors**2).sum(1).mean()))
