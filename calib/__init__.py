"""Calibrates a camera that looks through a refractive cover: the whole interface of the library,
which docs/library.md shows at work.

A name is imported when it is first asked for, so that reading a session does not wait for torch.
"""

from typing import TYPE_CHECKING

__all__ = [
    "Calibration",
    "InputError",
    "Measurer",
    "NotEnoughDataError",
    "Progress",
    "RefracalError",
    "Settings",
    "Silent",
    "TagLocator",
    "Undistorter",
    "diagnose",
    "evaluate",
    "fit",
    "read_session",
]

if TYPE_CHECKING:
    from calib.apply.measure import Measurer
    from calib.apply.tags import TagLocator
    from calib.apply.undistorter import Undistorter
    from calib.calibration import Calibration
    from calib.diagnosis.diagnose import diagnose
    from calib.errors import InputError, NotEnoughDataError, RefracalError
    from calib.fitting.evaluate import evaluate
    from calib.fitting.fit import fit
    from calib.fitting.stages import Settings
    from calib.progress import Progress, Silent
    from calib.session.session import read_session
else:  # out of the type checker's sight, so that it still refuses a name that is misspelt
    _HOMES = {
        "Calibration": "calib.calibration",
        "InputError": "calib.errors",
        "Measurer": "calib.apply.measure",
        "NotEnoughDataError": "calib.errors",
        "Progress": "calib.progress",
        "RefracalError": "calib.errors",
        "Settings": "calib.fitting.stages",
        "Silent": "calib.progress",
        "TagLocator": "calib.apply.tags",
        "Undistorter": "calib.apply.undistorter",
        "diagnose": "calib.diagnosis.diagnose",
        "evaluate": "calib.fitting.evaluate",
        "fit": "calib.fitting.fit",
        "read_session": "calib.session.session",
    }

    def __getattr__(name: str) -> object:
        if name not in _HOMES:
            raise AttributeError(f"module 'calib' has no attribute {name!r}")
        from importlib import import_module

        found = globals()[name] = getattr(import_module(_HOMES[name]), name)
        return found

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
