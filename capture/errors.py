"""Errors of the device: a camera that is missing, busy or unplugged, or a full disk."""

from calib.errors import RefracalError


class CaptureError(RefracalError):
    """The device failed. The message is one sentence that says what to do."""

    exit_code = 4
