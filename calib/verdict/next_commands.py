"""The next commands of a verdict, with their real paths, quoted for a shell."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path

from calib.fit_record.request import Settings
from calib.io.images import frames_folder


@dataclass(frozen=True, slots=True)
class NextCommands:
    """Commands about one calibration."""

    session: Path
    folder: Path
    """The folder of the calibration."""
    settings: Settings
    """The settings of its fit."""
    records: bool = True
    """True if capture records such views: not those of a target of points, which come from another
    program, and not pictures that lie beside session.yaml, which come from another device.
    """
    has_pictures: bool = False
    """True if the session has pictures, and not corners alone."""

    def fit(self, *options: str) -> str:
        """Return the same fit, for a corrected session or with other options."""
        words = ["calib", "fit", str(self.session)]
        if self.settings.method != Settings().method:
            words += ["--method", self.settings.method]
        grid = self.settings.grid
        if "--grid" not in options and grid and grid != Settings().grid:
            words += ["--grid", "x".join(map(str, grid))]
        if "--free" not in options and self.settings.free != Settings().free:
            words += ["--free", ",".join(self.settings.free) or "none"]
        if self.folder != self.session / "calibration":
            words += ["-o", str(self.folder)]
        return shlex.join([*words, *options])

    def capture(self) -> str:
        """Return the command that records more views, or that fits them when they are there."""
        if not self.records:
            return self.fit()
        return shlex.join(["capture", str(self.session)])

    def diagnose(self, *options: str) -> str:
        return shlex.join(["calib", "diagnose", str(self.folder), *options])

    def check(self, session: str) -> str:
        """Return the check by the pictures of a session."""
        return shlex.join(["calib", "check", str(self.folder), session])

    def evaluate(self) -> str:
        """Return the evaluation on other views, whose session the user names."""
        return shlex.join(["calib", "evaluate", str(self.folder), "HOLDOUT"])

    def undistort(self, depth: float) -> str:
        """Return the undistortion of the session's pictures for a depth in m."""
        folder = str(self.folder)
        pictures, out = str(frames_folder(self.session)), str(self.folder / "undistorted")
        return shlex.join(
            ["calib", "undistort", folder, pictures, "--depth", f"{depth:.2g}", "-o", out]
        )

    def uses(self, depth: float, *, mapped: bool) -> tuple[str, ...]:
        """Return the commands that use a calibration which is trusted, the first one first: a
        straight picture, if the session has pictures, and maps for other programs, unless they are
        written already.

        Args:
            depth: m
            mapped: true if the maps for this depth are written.
        """
        straight = (self.undistort(depth),) if self.has_pictures else ()
        return straight + (() if mapped else (self.export(depth),))

    def report(self) -> str:
        return shlex.join(["calib", "report", str(self.folder)])

    def export(self, depth: float) -> str:
        """Return the export of maps for a depth in m."""
        folder = str(self.folder)
        return shlex.join(
            [
                "calib",
                "export",
                folder,
                "--format",
                "npz",
                "--depth",
                f"{depth:.2g}",
                "-o",
                str(self.folder / "export"),
            ]
        )
