"""The field that names another session. Each name is read once."""

from contextlib import suppress
from pathlib import Path

from calib.errors import InputError
from capture.session_file import Setup
from capture.tui.fit_requirements import is_lens_known
from capture.tui.lens_transfer import read_lens, write_lens
from capture.tui.page import Field
from capture.tui.path_suggester import PathSuggester
from capture.tui.references import read_like
from capture.tui.session_state import has_session_file


class LikeField(Field):
    """A field that names another session. It gives a new session its board, cover and lens; it
    gives an existing session the lens, as long as that is missing.
    """

    def __init__(self, session: Path) -> None:
        super().__init__(id="like", suggester=PathSuggester(kinds=False), compact=True)
        self._session = session
        self.setup: Setup | None = None
        """The set-up of the named session, or this session's own where it exists."""
        self._name_read = ""
        """The name from which `setup` was read."""

    def restore(self, like: str) -> None:
        self.value = like
        with suppress(InputError):  # the error is shown when the field gets the focus
            self.setup = read_like(like)
            self._name_read = like

    def enable(self) -> None:
        """Enable the field for an existing session, as long as its lens is missing."""
        self.disabled = self.setup is None or is_lens_known(self._session, self.setup)
        if not self.disabled:  # the session named before had no lens to give
            self.value = self._name_read = ""

    def read_if_changed(self) -> Setup | None:
        """Return another session's set-up if this name was not read before; InputError where that
        session gives nothing useful.
        """
        if self.value == self._name_read or self.disabled:
            return None
        self.setup, self._name_read = None, ""
        self.setup = (
            read_lens(self._session, self.value)
            if has_session_file(self._session)
            else read_like(self.value)
        )
        self._name_read = self.value
        return self.setup

    def transfer_lens(self) -> None:
        """Write the other session's lens into an existing session."""
        if (
            self.setup
            and self.value.strip()
            and not self.disabled
            and has_session_file(self._session)
        ):
            write_lens(self._session, self.setup)
            self.disabled = True
