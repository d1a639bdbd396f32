"""Calibrate a camera that looks through a refractive cover: the public interface of the library.
docs/library.md shows examples.

A name is imported when it is first used, so that reading a session does not wait for torch.
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
    from calib.fit_record.request import Settings
    from calib.fitting.evaluate import evaluate
    from calib.fitting.fit import fit
    from calib.progress import Progress, Silent
    from calib.session.session import read_session
else:  # hidden from the type checker, so that it still refuses a misspelt name
    _MODULES = {
        "Calibration": "calib.calibration",
        "InputError": "calib.errors",
        "Measurer": "calib.apply.measure",
        "NotEnoughDataError": "calib.errors",
        "Progress": "calib.progress",
        "RefracalError": "calib.errors",
        "Settings": "calib.fit_record.request",
        "Silent": "calib.progress",
        "TagLocator": "calib.apply.tags",
        "Undistorter": "calib.apply.undistorter",
        "diagnose": "calib.diagnosis.diagnose",
        "evaluate": "calib.fitting.evaluate",
        "fit": "calib.fitting.fit",
        "read_session": "calib.session.session",
    }

    def __getattr__(name: str) -> object:
        if name not in _MODULES:
            raise AttributeError(f"module 'calib' has no attribute {name!r}")
        from importlib import import_module

        value = globals()[name] = getattr(import_module(_MODULES[name]), name)
        return value

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
