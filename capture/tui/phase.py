"""The choice of what is recorded now: as it is proposed, but what the person chose stays."""

from typing import cast

from textual.widgets import Select

PHASES = (("without the cover, into bare/", True), ("through the cover, into frames/", False))


class Phase(Select[bool]):
    def __init__(self) -> None:
        super().__init__(PHASES, allow_blank=False, id="phase", compact=True)
        self._proposed: bool | None = None
        """To record without the cover: what the program chose last. None: nothing yet."""

    @property
    def bare(self) -> bool:
        return cast(bool, self.value)

    @property
    def chosen(self) -> bool | None:
        """To record without the cover, where the person chose that."""
        return None if self.bare == self._proposed else self.bare

    @property
    def untouched(self) -> bool:
        """Nothing was proposed yet, nor taken up from the last time."""
        return self._proposed is None

    def restore(self, bare: bool | None) -> None:
        """As the person chose it the last time, if at all."""
        if bare is not None:
            self.value = bare
            self._proposed = not bare

    def propose(self, bare: bool) -> None:
        if self.untouched or self.bare == self._proposed:
            self.value = self._proposed = bare
