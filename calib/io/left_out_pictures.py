"""The pictures of a recording that cannot be used, while the others are."""

from collections.abc import Sequence

from calib.errors import InputError

PATIENCE = 30
"""If so many pictures cannot be used before one can, the recording is refused: to read on would
only take time.
"""


class LeftOutPictures:
    """Counts the pictures that are left out, and keeps the reason for the first."""

    def __init__(self) -> None:
        self._count = 0
        self._first: InputError | None = None

    def note(self, error: InputError, used: int) -> None:
        """Count a picture.

        Args:
            error: why it cannot be used.
            used: the number of pictures that could be.

        Raises:
            InputError: none of the first PATIENCE can be used.
        """
        self._first = self._first or error
        self._count += 1
        if not used and self._count == PATIENCE:
            raise self._first

    def check(self, used: int) -> None:
        """Raise the first picture's InputError if none could be used; return if there was none."""
        if self._first and not used:
            raise self._first

    def sentences(self) -> Sequence[str]:
        """Return a sentence to print if pictures are left out."""
        if not self._count:
            return ()
        if self._count == 1:
            return (f"1 picture is left out: {self._first}",)
        return (f"{self._count} pictures are left out, the first for this: {self._first}",)
