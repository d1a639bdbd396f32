"""What fails on the device's side: a camera that is not there, busy or unplugged, a disk that is
full.
"""

from calib.errors import RefracalError


class CaptureError(RefracalError):
    """The device failed. The message is one sentence that says what to do."""

    exit_code = 4
