"""Calibrate a camera behind a glass cover: the public interface of the library.
docs/library.md shows examples.

A name is imported when it is first used, so that reading a session does not wait for torch.
"""

from typing import TYPE_CHECKING

from calib.version import VERSION as __version__

__all__ = [
    "Calibration",
    "InputError",
    "Measurer",
    "NotEnoughDataError",
    "Progress",
    "RefracalError",
    "Rig",
    "Settings",
    "Silent",
    "TagLocator",
    "Undistorter",
    "WrongTypeError",
    "__version__",
    "calibrate",
    "check_rig",
    "describe",
    "diagnose",
    "diagnose_rig",
    "evaluate",
    "evaluate_rig",
    "fit",
    "fit_rig",
    "judge",
    "read_session",
]

if TYPE_CHECKING:
    from calib.apply.measure import Measurer
    from calib.apply.tags import TagLocator
    from calib.apply.undistorter import Undistorter
    from calib.calibration import Calibration
    from calib.diagnosis.diagnose import diagnose
    from calib.errors import InputError, NotEnoughDataError, RefracalError, WrongTypeError
    from calib.fit_record.request import Settings
    from calib.fitting.description import describe
    from calib.fitting.evaluate import evaluate
    from calib.fitting.fit import fit
    from calib.fitting.from_points import calibrate
    from calib.progress import Progress, Silent
    from calib.rig.check_rig import check_rig
    from calib.rig.diagnose_rig import diagnose_rig
    from calib.rig.evaluate_rig import evaluate_rig
    from calib.rig.fit_rig import fit_rig
    from calib.rig.rig import Rig
    from calib.session.session import read_session
    from calib.verdict.judge import judge
else:  # hidden from the type checker, so that it still refuses a misspelt name
    _MODULES = {
        "Calibration": "calib.calibration",
        "InputError": "calib.errors",
        "Measurer": "calib.apply.measure",
        "NotEnoughDataError": "calib.errors",
        "Progress": "calib.progress",
        "RefracalError": "calib.errors",
        "Rig": "calib.rig.rig",
        "Settings": "calib.fit_record.request",
        "Silent": "calib.progress",
        "TagLocator": "calib.apply.tags",
        "Undistorter": "calib.apply.undistorter",
        "WrongTypeError": "calib.errors",
        "calibrate": "calib.fitting.from_points",
        "check_rig": "calib.rig.check_rig",
        "describe": "calib.fitting.description",
        "diagnose": "calib.diagnosis.diagnose",
        "diagnose_rig": "calib.rig.diagnose_rig",
        "evaluate": "calib.fitting.evaluate",
        "evaluate_rig": "calib.rig.evaluate_rig",
        "fit": "calib.fitting.fit",
        "fit_rig": "calib.rig.fit_rig",
        "judge": "calib.verdict.judge",
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
