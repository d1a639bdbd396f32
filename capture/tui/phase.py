"""The choice of what is recorded now: as it is proposed, but what the person chose stays."""

from textual.widgets import Select

BARE, ANEW, COVERED = "bare", "anew", "covered"
PHASES = (("without the cover, into bare/", BARE), ("through the cover, into frames/", COVERED))


class Phase(Select[str]):
    def __init__(self) -> None:
        super().__init__(PHASES, allow_blank=False, id="phase", compact=True)
        self._proposed: bool | None = None
        """To record without the cover: what the program chose last. None: nothing yet."""

    @property
    def bare(self) -> bool:
        return self.value != COVERED

    @bare.setter
    def bare(self, bare: bool) -> None:
        if bare != self.bare:
            self.value = BARE if bare else COVERED

    @property
    def anew(self) -> bool:
        """Without the cover, and the views that are there already are no good."""
        return self.value == ANEW

    @property
    def chosen(self) -> bool | None:
        """To record without the cover, where the person chose that."""
        return None if self.bare == self._proposed else self.bare

    @property
    def untouched(self) -> bool:
        """Nothing was proposed yet, nor taken up from the last time."""
        return self._proposed is None

    def offer(self, there: int) -> None:
        """Of a session with so many views without the cover; not again what was chosen for the last
        recording alone, to take them anew.
        """
        anew = (f"without the cover, anew ({there} go to bare-aside/)", ANEW)
        bare = self.bare
        with self.prevent(Select.Changed):
            self.set_options((*PHASES, anew) if there else PHASES)
            self.value = BARE if bare else COVERED

    def restore(self, bare: bool | None) -> None:
        """As the person chose it the last time, if at all."""
        if bare is not None:
            self.bare = bare
            self._proposed = not bare

    def propose(self, bare: bool) -> None:
        if self.untouched or self.bare == self._proposed:
            self.bare = self._proposed = bare
