"""Everything that can go wrong by someone's input, in one tree. The message is one sentence that says what to do.

Anything else that is raised is a bug, and exits with 1.
"""


class RefracalError(Exception):
    """A problem that the person at the keyboard can solve. The command prints the sentence and exits with `exit_code`."""

    exit_code = 2


class InputError(RefracalError):
    """Wrong usage or wrong input: a missing file, an unknown key, a truncated image."""


class NotEnoughDataError(RefracalError):
    """The input is well formed, but too little of it is good enough to calibrate from."""

    exit_code = 3
