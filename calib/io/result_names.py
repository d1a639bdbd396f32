"""The names of a calibration's files, which ROS and others use as well."""

CALIBRATION_FILE = "calibration.yaml"
"""The numbers of a calibration, for people."""
CALIBRATION_ARRAYS = "calibration.npz"
RIG_CALIBRATION_FILE = "rig_calibration.yaml"
"""The numbers of a calibrated rig, for people."""
RIG_CALIBRATION_ARRAYS = "rig_calibration.npz"
