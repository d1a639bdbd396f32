"""The field that names another session, which is read once for every name."""

from contextlib import suppress
from pathlib import Path

from calib.errors import InputError
from capture.session_file import Setup
from capture.tui.fit_requirements import lens_known
from capture.tui.lens_transfer import lend_lens, lens_of
from capture.tui.page import Field
from capture.tui.references import read_like
from capture.tui.session_state import described


class Like(Field):
    """For a new session it gives board, cover and lens; for one that exists the lens, for as long
    as that is missing.
    """

    def __init__(self, session: Path) -> None:
        super().__init__(id="like", compact=True)
        self._session = session
        self.setup: Setup | None = None
        """What the session that is named says, or this one's own where it exists."""
        self._followed = ""
        """The name that `setup` was read from."""

    def restore(self, like: str) -> None:
        self.value = like
        with suppress(InputError):  # said as the field is looked at
            self.setup = read_like(like)
            self._followed = like

    def open(self) -> None:
        """Of a session that exists: for as long as its lens is missing."""
        self.disabled = self.setup is None or lens_known(self._session, self.setup)
        if not self.disabled:  # what it named before had no lens to give
            self.value = self._followed = ""

    def follow(self) -> Setup | None:
        """What another session says, where it was not read by this name before; InputError where it
        says nothing of use.
        """
        if self.value == self._followed or self.disabled:
            return None
        self.setup, self._followed = None, ""
        self.setup = (
            lens_of(self._session, self.value)
            if described(self._session)
            else read_like(self.value)
        )
        self._followed = self.value
        return self.setup

    def lend(self) -> None:
        """To a session that exists, the lens of the other one."""
        if self.setup and self.value.strip() and not self.disabled and described(self._session):
            lend_lens(self._session, self.setup)
            self.disabled = True
