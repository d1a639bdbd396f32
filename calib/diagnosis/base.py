"""The model that a diagnosis starts from: a calibration's, with what its fit estimated free again."""

from calib.calibration import Calibration
from calib.model import Model
from calib.priors import freed

FOCAL, CENTRE, COEFFICIENT = 0.05, 100.0, 3.0
"""Priors of intrinsics that come from these same views: of the focal length, in px, and of a coefficient. They hardly hold anything."""


def base_model(calibration: Calibration) -> Model:
    """What the calibration's fit started from, as far as it says."""
    path, values = calibration.model()
    assert calibration.camera.intrinsics
    free = dict(freed(calibration.camera.intrinsics, calibration.cover, path))
    if calibration.settings.get("intrinsics_from") == "views":
        focal = FOCAL * float(values["camera.fx"])
        own = {"camera.fx": focal, "camera.fy": focal, "camera.cx": CENTRE, "camera.cy": CENTRE}
        free |= {param.name: own.get(param.name, COEFFICIENT) for param in path.lens.params}
    means = dict(values)
    if calibration.relief:
        means["relief.amplitudes"] = values["relief.amplitudes"] * 0.0
    for found in calibration.effects:
        for unknown in found.effect.unknowns:
            means[unknown.param.name] = values[unknown.param.name] * 0.0 + (unknown.neutral if unknown.start is None else unknown.start)
            free[unknown.param.name] = unknown.sigma
    return Model(path, means, free, tuple(found.effect for found in calibration.effects))
