"""The choice of the recorded phase. The program proposes one; a person's choice stays."""

from textual.widgets import Select

BARE, ANEW, COVERED = "bare", "anew", "covered"
OPTIONS = (("without the cover, into bare/", BARE), ("through the cover, into frames/", COVERED))


class PhaseField(Select[str]):
    def __init__(self) -> None:
        super().__init__(OPTIONS, allow_blank=False, id="phase", compact=True)
        self._proposed: bool | None = None
        """True if the program proposed last to record without the cover. None: no proposal yet."""

    @property
    def bare(self) -> bool:
        return self.value != COVERED

    @bare.setter
    def bare(self, bare: bool) -> None:
        if bare != self.bare:
            self.value = BARE if bare else COVERED

    @property
    def is_retake(self) -> bool:
        """True if the phase is without the cover, and the existing views are to be replaced."""
        return self.value == ANEW

    @property
    def choice(self) -> bool | None:
        """True or False if the person chose the phase without or with the cover; else None."""
        return None if self.bare == self._proposed else self.bare

    @property
    def is_untouched(self) -> bool:
        """True if nothing was proposed yet, nor restored from the last time."""
        return self._proposed is None

    def offer(self, bare_views: int) -> None:
        """Set the options for a session with this many views without the cover. The choice to take
        them anew counts for one recording only.
        """
        is_retake = (f"without the cover, anew ({bare_views} go to bare-aside/)", ANEW)
        bare = self.bare
        with self.prevent(Select.Changed):
            self.set_options((*OPTIONS, is_retake) if bare_views else OPTIONS)
            self.value = BARE if bare else COVERED

    def restore(self, bare: bool | None) -> None:
        """Restore the person's last choice, if there was one."""
        if bare is not None:
            self.bare = bare
            self._proposed = not bare

    def propose(self, bare: bool) -> None:
        if self.is_untouched or self.bare == self._proposed:
            self.bare = self._proposed = bare
