"""The names of a calibration's files, which ROS and others use as well."""

from pathlib import Path

CALIBRATION_FILE = "calibration.yaml"
"""The numbers of a calibration, for people."""
CALIBRATION_ARRAYS = "calibration.npz"
RIG_CALIBRATION_FILE = "rig_calibration.yaml"
"""The numbers of a calibrated rig, for people."""
RIG_CALIBRATION_ARRAYS = "rig_calibration.npz"


def has_only_results(folder: Path) -> bool:
    """True if a folder has a calibration, and no description of a session or a rig: a session may
    have a calibration beside its pictures. OSError if the folder cannot be read.
    """
    results = (CALIBRATION_FILE, RIG_CALIBRATION_FILE)
    descriptions = ("session.yaml", "rig.yaml")
    return any((folder / name).is_file() for name in results) and not any(
        (folder / name).is_file() for name in descriptions
    )
