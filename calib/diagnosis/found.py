"""What an accepted effect says of its set-up, for people: declared numbers with their increments,
its own parameters as they are.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from calib.calibration import Calibration
from calib.diagnosis.finding import ParameterEstimate
from calib.fitting.declared import comparisons, own_parameters
from calib.optics.board_target import FLEX, block_columns


def found(
    effect: str, calibration: Calibration, parameters: Mapping[str, ParameterEstimate]
) -> list[str]:
    """One for each number; of parameters of single views, how large they are.

    Args:
        effect: its name.
        calibration: with it.
        parameters: as the diagnosis lists them; of a field, its root mean square.
    """
    said = [one.summed for one in comparisons(calibration) if one.effect == effect]
    said += [
        f"{one.name} {one.estimated}" for one in own_parameters(calibration) if one.effect == effect
    ]
    said += [f"{name} {one}" for name, one in parameters.items() if name.endswith(".rms")]
    part = next(
        (added.effect.per_view for added in calibration.effects if added.effect.name == effect), ""
    )
    return [*said, *_of_views(part, calibration)] if part else said


def _of_views(part: str, calibration: Calibration) -> list[str]:
    """The size of what views have for themselves, root mean square."""
    path, _ = calibration.model()
    own = calibration.poses[:, block_columns(path.view_blocks)[part]]
    if part == FLEX:
        return [f"boards bend by {1e3 * _rms(own):.2g} mm (root mean square over views and terms)"]
    shutter = calibration.camera.shutter
    seconds, per = (shutter.readout, "second") if shutter and shutter.readout else (1.0, "readout")
    turn, move = np.degrees(_rms(own[:, :3])) / seconds, 1e3 * _rms(own[:, 3:]) / seconds
    return [
        f"boards turn by {turn:.2g} degrees and move by {move:.2g} mm in a {per} (root mean square"
        " over views)"
    ]


def _rms(own: NDArray[np.float64]) -> float:
    """Of the vectors' lengths."""
    return float(np.sqrt((own**2).sum(1).mean()))
