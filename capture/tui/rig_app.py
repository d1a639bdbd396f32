"""The terminal UI that records a rig: one screen."""

from collections.abc import Sequence

from calib.errors import harmless
from calib.io.numerals import counted
from capture.rig.rig_setup import RigSetup
from capture.tui.app import CaptureApp
from capture.tui.page import Page
from capture.tui.rig_screen import RigScreen


class RigApp(CaptureApp):
    def __init__(self, setup: RigSetup) -> None:
        super().__init__(setup.rig.path)
        self._rig_screen = RigScreen(setup)

    def first_screen(self) -> Page:
        return self._rig_screen

    @property
    def farewell(self) -> Sequence[str]:
        """The lines for the terminal after the screen has gone."""
        rig = self._rig_screen.setup.rig
        shared = self._rig_screen.shared_count
        if not self._rig_screen.views:
            return [harmless(f"No view is recorded in {rig.path} yet.")]
        alone = len(self._rig_screen.views) - shared
        views = counted(shared, "shared view")
        return [
            harmless(f"{views} and {alone} of one camera alone are in {rig.path}."),
            harmless(f"Next: {rig.fit_command}"),
        ]
