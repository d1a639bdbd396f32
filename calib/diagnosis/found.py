"""What an accepted effect says of its set-up, for people: declared numbers with their increments, its own parameters as they are."""

from collections.abc import Mapping

from calib.calibration import Calibration
from calib.diagnosis.finding import ParameterEstimate
from calib.fitting.declared import comparisons, own_parameters


def found(effect: str, calibration: Calibration, parameters: Mapping[str, ParameterEstimate]) -> list[str]:
    """One for each number; none where all its parameters are those of single views.

    Args:
        effect: its name.
        calibration: with it.
        parameters: as the diagnosis lists them; of a field, its root mean square.
    """
    said = [one.summed for one in comparisons(calibration) if one.effect == effect]
    said += [f"{one.name} {one.estimated}" for one in own_parameters(calibration) if one.effect == effect]
    return [*said, *(f"{name} {one}" for name, one in parameters.items() if name.endswith(".rms"))]
